"""How well a chain of motions lays each sweep on one several frames later.

The cycle check tests consistency, not truth: on a slow drive an estimate that stands still passes
it. Over many frames the error adds up until static surfaces no longer meet.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.errors import FrameError, MissingEvidenceError
from tcrdata.evidence.alignment import share_with_neighbour
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.point_flow import moved
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching, read_encoded
from tcrdata.evidence.poses import Poses
from tcrdata.types import CueInput, Dataset, Float32Array, Frame


@dataclass(frozen=True)
class Alignment:
    """What one frame's alignment was.

    Attributes:
        frame: the sweep that is carried.
        frames_later: the position, counted in usable frames, of the sweep it is laid on.
        share: its non-ground points that have a neighbour there; None when it cannot be read.
    """

    frame: int
    frames_later: int
    share: float | None


@dataclass(frozen=True)
class _Item:
    frame: Frame
    later: Frame
    frames_later: int


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    items: tuple[_Item, ...]
    poses: Poses
    ground: dict[int, EncodedPoints]
    radius_m: float
    points: int


def alignments(
    cue: CueInput,
    poses: Poses,
    *,
    frames_later: int,
    radius_m: float,
    points: int,
    frames_per_task: int,
) -> Iterator[Alignment]:
    """Yield the alignment of every frame that is linked to a later one, in order.

    Args:
        cue: the sequence; `ground` says which points are ground, where it was measured.
        poses: the chained motions.
        frames_later: how far to look, or to the last frame that is linked.
        radius_m: a neighbour this near counts, metres of this world.
        points: at most so many points are carried.
        frames_per_task: frames a worker takes at once.
    """
    for part in cue.parallel(
        _measure_task,
        (
            _task(cue, poses, items, radius_m, points)
            for items in chunked(_items(cue.frames, poses, frames_later), frames_per_task)
        ),
    ):
        yield from part


def frames_to_lay_on(
    order: Sequence[int], poses: Poses, frames_later: int
) -> dict[int, tuple[int, int]]:
    """Return for each frame the linked one it is laid on, and how many usable frames later that is.

    Args:
        order: numbers of the usable frames, rising.
        poses: the chained motions.
        frames_later: how far to look; less where fewer frames are linked.
    """
    found = {}
    for i, frame in enumerate(order):
        for j in range(min(i + frames_later, len(order) - 1), i, -1):
            if poses.linked(frame, order[j]):
                found[frame] = (order[j], j - i)
                break
    return found


def _items(frames: Sequence[Frame], poses: Poses, frames_later: int) -> list[_Item]:
    known = {frame.frame: frame for frame in frames}
    found = frames_to_lay_on(list(known), poses, frames_later)
    return [_Item(known[n], known[later], count) for n, (later, count) in found.items()]


def _task(
    cue: CueInput, poses: Poses, items: tuple[_Item, ...], radius_m: float, points: int
) -> _Task:
    numbers = sorted({frame.frame for item in items for frame in (item.frame, item.later)})
    ground = ((number, read_encoded(cue.tables, number, "ground")) for number in numbers)
    return _Task(
        dataset=cue.dataset,
        items=items,
        poses=poses.only(numbers),
        ground={number: mask for number, mask in ground if mask is not None},
        radius_m=radius_m,
        points=points,
    )


def _measure_task(task: _Task) -> list[Alignment]:
    kept: dict[int, Float32Array] = {}
    measured = []
    for item in task.items:
        kept = {number: xyz for number, xyz in kept.items() if number >= item.frame.frame}
        measured.append(Alignment(item.frame.frame, item.frames_later, _share(task, item, kept)))
    return measured


def _share(task: _Task, item: _Item, kept: dict[int, Float32Array]) -> float | None:
    try:
        for frame in (item.frame, item.later):
            if frame.frame not in kept:
                kept[frame.frame] = _objects(task, frame)
    except (FrameError, MissingEvidenceError):
        # The estimate stands without its alignment; the cue that made it reports the frame.
        return None
    xyz = kept[item.frame.frame]
    stride = max(-(-len(xyz) // task.points), 1)
    carry = task.poses.a_T_b(item.later.frame, item.frame.frame)
    carried = moved(np.ascontiguousarray(xyz[::stride]), carry)
    return share_with_neighbour(carried, kept[item.later.frame], task.radius_m)


def _objects(task: _Task, frame: Frame) -> Float32Array:
    xyz = task.dataset.read_points(frame).xyz
    ground = task.ground.get(frame.frame)
    return xyz if ground is None else xyz[~decode_matching(ground, len(xyz))]
