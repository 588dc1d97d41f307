"""The frames of one sequence in the world: their poses, their clock, boxes carried to and fro."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from tcrdata.evidence.poses import Poses
from tcrdata.types import FloatArray, Frame

LEAST_GAP_FRAMES = 3
"""So many missing frames, as many as a track may miss, still count as one drive; more cut it."""


@dataclass(frozen=True)
class World:
    """The frames of a sequence that have a pose.

    Attributes:
        frames: frame number to frame, in order.
        poses: of these frames.
        interval_s: median seconds between frames whose numbers differ by one.
        timed: whether the timestamps rise; else the interval is only a guess.
    """

    frames: Mapping[int, Frame]
    poses: Poses
    interval_s: float
    timed: bool

    def begins(self, frame: int) -> bool:
        """Whether nothing was seen right before a frame: the drive or a part of it begins there."""
        return not self._seen_together(frame, self._places[frame] - 1)

    def ends(self, frame: int) -> bool:
        """Whether nothing was seen right after a frame: the drive or a part of it ends there."""
        return not self._seen_together(frame, self._places[frame] + 1)

    @cached_property
    def _places(self) -> dict[int, int]:
        return {frame: place for place, frame in enumerate(self.frames)}

    @cached_property
    def _numbers(self) -> list[int]:
        return list(self.frames)

    def _seen_together(self, frame: int, place: int) -> bool:
        """Whether a frame and its neighbour at a place are linked, and without a longer gap."""
        if not 0 <= place < len(self._numbers):
            return False
        other = self._numbers[place]
        return self.poses.linked(frame, other) and abs(other - frame) <= 1 + LEAST_GAP_FRAMES

    def point_to_world(self, frame: int, point: FloatArray) -> FloatArray:
        """Return (..., 3) level points of a frame in the world."""
        pose = self.poses.world_T_level[frame]
        return np.asarray(point @ pose[:3, :3].T + pose[:3, 3])

    def sensor(self, frame: int) -> FloatArray:
        """Return the (3,) place of the sensor in the world."""
        return self.point_to_world(frame, self.frames[frame].sensor_matrix[:3, 3])

    def box_to_world(self, frame: int, box: FloatArray) -> FloatArray:
        """Return a (7,) box of a frame's level frame in the world."""
        turn = self.poses.world_T_level[frame][:3, :3]
        heading = turn @ np.array([math.cos(box[6]), 0.0, -math.sin(box[6])])
        center = self.point_to_world(frame, box[:3])
        return np.array([*center, *box[3:6], math.atan2(-heading[2], heading[0])])

    def box_to_level(self, frame: int, box: FloatArray) -> FloatArray:
        """Return a (7,) box of the world in a frame's level frame."""
        pose = self.poses.world_T_level[frame]
        center = (box[:3] - pose[:3, 3]) @ pose[:3, :3]
        heading = np.array([math.cos(box[6]), 0.0, -math.sin(box[6])]) @ pose[:3, :3]
        return np.array([*center, *box[3:6], math.atan2(-heading[2], heading[0])])


def make_world(frames: Sequence[Frame], poses: Poses) -> World:
    """Return the world of the frames that have a pose."""
    known = {frame.frame: frame for frame in frames if frame.frame in poses}
    listed = list(known.values())
    rates = [
        (b.timestamp_ns - a.timestamp_ns) * 1e-9 / (b.frame - a.frame) for a, b in pairwise(listed)
    ]
    interval = float(np.median(rates)) if rates else 0.0
    return World(known, poses, interval if interval > 0 else 0.1, interval > 0)
