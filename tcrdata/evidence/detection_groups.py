"""Detections of many frames at one place in the world: an object that stands still.

A group is what was seen within reach of its surest detection, at most once a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.evidence.world import World
from tcrdata.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Detections:
    """The detections of a sequence, N of them, by frame.

    Attributes:
        frame: (N,) frame numbers.
        boxes: (N, 7) world.
        score: (N,) of the detector.
        segment: (N,) part of the drive that its poses link.
    """

    frame: IntArray
    boxes: FloatArray
    score: FloatArray
    segment: IntArray


@dataclass(frozen=True)
class Group:
    """Detections of one standing object.

    Attributes:
        box: (7,) world, mean of its detections weighted by their scores.
        frames: of its detections, rising.
        scores: of its detections, by frame.
        segment: part of the drive.
        spread_m: root mean square distance of the detections' centres to the box's.
    """

    box: FloatArray
    frames: tuple[int, ...]
    scores: tuple[float, ...]
    segment: int
    spread_m: float

    @property
    def best_half_score(self) -> float:
        """Mean of the surer half of its scores, the middle one included."""
        ordered = sorted(self.scores, reverse=True)
        return float(np.mean(ordered[: (len(ordered) + 1) // 2]))


def standing_groups(found: Detections, reach_m: float, gap_frames: int, fewest: int) -> list[Group]:
    """Return the groups of some detections, by first frame, the surer first.

    Args:
        found: detections.
        reach_m: a group's detections lie so near its surest one.
        gap_frames: a longer pause ends a group: another thing may stand there later.
        fewest: detections of a group.
    """
    free = np.ones(len(found.frame), dtype=bool)
    groups: list[Group] = []
    for seed in np.lexsort((found.frame, -found.score)):
        if free[seed]:
            members = _members(found, int(seed), free, reach_m, gap_frames)
            free[members] = False
            if len(members) >= fewest:
                groups.append(_group(found, members))
    return sorted(groups, key=lambda group: (group.frames[0], -group.best_half_score))


def _members(
    found: Detections, seed: int, free: BoolArray, reach_m: float, gap_frames: int
) -> IntArray:
    """Return the free detections near a seed, the nearest of each frame, without a long pause."""
    off = found.boxes[:, [0, 2]] - found.boxes[seed, [0, 2]]
    distance = np.hypot(off[:, 0], off[:, 1])
    near = free & (distance <= reach_m) & (found.segment == found.segment[seed])
    listed = np.flatnonzero(near)
    listed = listed[np.lexsort((distance[listed], found.frame[listed]))]
    frames, first = np.unique(found.frame[listed], return_index=True)
    listed = listed[first]
    part = np.concatenate([[0], np.cumsum(np.diff(frames) > gap_frames)])
    own = part[np.searchsorted(frames, found.frame[seed])]
    members: IntArray = listed[part == own]
    return members


def _group(found: Detections, members: IntArray) -> Group:
    boxes, weights = found.boxes[members], found.score[members]
    box = np.average(boxes, axis=0, weights=weights)
    box[3:6] = np.exp(np.average(np.log(boxes[:, 3:6]), axis=0, weights=weights))
    box[6] = _mean_yaw(boxes[:, 6], weights)
    gaps = np.hypot(boxes[:, 0] - box[0], boxes[:, 2] - box[2])
    return Group(
        box,
        tuple(found.frame[members].tolist()),
        tuple(weights.tolist()),
        int(found.segment[members[0]]),
        float(np.sqrt((gaps**2).mean())),
    )


def _mean_yaw(yaw: FloatArray, weights: FloatArray) -> float:
    """Return the mean of axes, pointing to where most of the headings point."""
    axis = np.angle((weights * np.exp(2j * yaw)).sum()) / 2
    ahead = (weights * np.cos(yaw - axis)).sum() >= 0
    return float(axis if ahead else axis + np.pi)


def in_world(
    world: World, frames: Sequence[int], boxes: FloatArray, scores: FloatArray
) -> Detections:
    """Return detections in the world; those of frames without a pose are left out.

    Args:
        world: poses.
        frames: (N,) number of each detection's frame.
        boxes: (N, 7), level frame of each.
        scores: (N,).
    """
    kept = [i for i, frame in enumerate(frames) if frame in world.frames]
    moved = [world.box_to_world(frames[i], boxes[i]) for i in kept]
    return Detections(
        np.array([frames[i] for i in kept], dtype=np.int64),
        np.array(moved, dtype=np.float64).reshape(-1, 7),
        np.asarray(scores, dtype=np.float64)[kept],
        np.array([world.poses.segment[frames[i]] for i in kept], dtype=np.int64),
    )
