"""Where the level frame was in the world: the chained egomotions of one estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.geometry.transforms import inverse
from tcrdata.types import FloatArray, Tables


@dataclass(frozen=True)
class Poses:
    """Poses of the frames of a sequence that an estimator could link.

    Attributes:
        world_T_level: frame number to (4, 4); the world is the level frame of the first frame of
            the segment.
        segment: frame number to the number of its segment. Where a link is missing a new segment
            with a world of its own begins: never mix points of two segments.
    """

    world_T_level: Mapping[int, FloatArray]
    segment: Mapping[int, int]

    def __contains__(self, frame: int) -> bool:
        return frame in self.world_T_level

    def linked(self, a: int, b: int) -> bool:
        """Whether both frames lie in one segment."""
        return a in self.segment and self.segment[a] == self.segment.get(b)

    def a_T_b(self, a: int, b: int) -> FloatArray:  # noqa: N802
        """Return the transform of level points of frame b to frame a; both in one segment."""
        return inverse(self.world_T_level[a]) @ self.world_T_level[b]

    def only(self, frames: Sequence[int]) -> Poses:
        """Return the poses of some frames, few enough to hand to a worker process."""
        kept = [frame for frame in frames if frame in self.segment]
        return Poses(
            {frame: self.world_T_level[frame] for frame in kept},
            {frame: self.segment[frame] for frame in kept},
        )


def read_poses(tables: Tables, method: str = "odometry", *, round: int | None = None) -> Poses:
    """Return the chained poses of one method's egomotions of this sequence.

    Args:
        tables: of the sequence.
        method: that estimated them.
        round: EM round in which; the tables' own when None.
    """
    columns = ["frame", "frame_to", "to_T_from"]
    of_round = {} if round is None else {"round": round}
    rows = tables.read("egomotions", columns=columns, method=method, **of_round).to_pylist()
    links = [(row["frame"], row["frame_to"], row["to_T_from"]) for row in rows]
    return chain(links)


def chain(links: Sequence[tuple[int, int, Sequence[float] | None]]) -> Poses:
    """Chain links (frame, frame_to, to_T_from as 16 numbers or None) into poses.

    `world_T_level[to] = world_T_level[from] @ inverse(to_T_from)`.
    """
    world_T_level: dict[int, FloatArray] = {}
    segment: dict[int, int] = {}
    segments = 0
    for frame, frame_to, to_T_from in sorted(links, key=lambda link: link[0]):
        if frame not in world_T_level:
            world_T_level[frame], segment[frame] = np.eye(4), segments
            segments += 1
        if to_T_from is None:
            continue
        motion = np.asarray(to_T_from, dtype=np.float64).reshape(4, 4)
        world_T_level[frame_to] = world_T_level[frame] @ inverse(motion)
        segment[frame_to] = segment[frame]
    return Poses(world_T_level, segment)
