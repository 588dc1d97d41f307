"""Copies of a sweep's labelled objects, set elsewhere in the same sweep.

A lidar shows an object as densely from every azimuth: turned about the sensor, its points are what
it would show there; moved away from it, the share 1 / factor^2 of them is. Copies are stretched,
since few objects move in a drive and their like come in other sizes (random object scaling: Yang
et al., ST3D, CVPR 2021).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import points_in_box
from tcrdata.geometry.transforms import yaw_rotation
from tcrdata.learning.augmentation import SweepAugmentation
from tcrdata.learning.clouds import Cloud, points_of_labels, still_shown
from tcrdata.networks.center_targets import LabelBoxes
from tcrdata.networks.grids import Region
from tcrdata.types import BoolArray, Float32Array, FloatArray, IntArray

_FEWEST_POINTS = 8
_TURNS = 32
_ROOM_M = 0.3
_GROUND_REACH_M = 2.5
_BEHIND_M = 0.3
# Twice the steps of a lidar of 64 beams, so that an object seen as points hides as a surface.
_CELL_RAD = (0.007, 0.0146)


def labelled_objects(cloud: Cloud) -> list[tuple[int, Cloud]]:
    """Return numbers of positive labels and their points, of those that show enough."""
    return [
        (int(number), cloud.chosen(np.flatnonzero(cloud.owner == number)))
        for number in np.flatnonzero(points_of_labels(cloud.owner, 0) >= _FEWEST_POINTS)
    ]


def with_copies(
    cloud: Cloud,
    labels: LabelBoxes,
    objects: Sequence[tuple[int, Cloud]],
    whole: IntArray,
    region: Region,
    settings: SweepAugmentation,
    rng: np.random.Generator,
) -> tuple[Cloud, LabelBoxes]:
    """Return a sweep and its labels with copies of labelled objects.

    A copy takes the first of several places where it stands free, nearer things do not hide it, and
    it leaves enough of every labelled object and other copy; with one place to try, large things
    would hardly ever find room. What a copy hides is taken out.

    Args:
        cloud: the points in the region.
        labels: of the frame.
        objects: `labelled_objects` of the whole sweep: those outside of the region, too.
        whole: (M,) points in the region of each label, before anything of it was hidden.
        region: where copies go.
        settings: those whose names begin with `pasted`, and `erased_most`.
        rng: random numbers.
    """
    for _ in range(settings.pasted if objects else 0):
        number, own = objects[int(rng.integers(len(objects)))]
        farther = float(rng.uniform(1.0, settings.pasted_farther))
        own = own.chosen(rng.random(len(own.xyz)) < farther**-2)
        if len(own.xyz) < _FEWEST_POINTS:
            continue
        before = labels.boxes[number]
        for box in _elsewhere(before, farther, settings.pasted_stretch, region, rng):
            made = _with_copy(cloud, own, before, box, whole, settings)
            if made is not None:
                cloud, whole = made, np.append(whole, len(own.xyz))
                labels = _with_box(labels, box, number)
                break
    return cloud, labels


def _with_copy(
    cloud: Cloud,
    own: Cloud,
    before: FloatArray,
    box: FloatArray,
    whole: IntArray,
    settings: SweepAugmentation,
) -> Cloud | None:
    """Return a sweep with an object's points in another box, which is set on the ground.

    None where it would not stand free, would be hidden, or would hide too much of a label.
    """
    floor = _free_floor(cloud, box)
    if floor is None:
        return None
    box[1] = floor - box[5] / 2
    copy = _moved(own, before, box)
    shown, seen = _shadows(cloud.xyz, copy.xyz)
    left = points_of_labels(cloud.owner[shown], len(whole))
    if seen.mean() < 1 - settings.pasted_hidden_share or not still_shown(
        left, whole, settings.erased_most
    ):
        return None
    copy = replace(copy, owner=np.full(len(copy.xyz), len(whole)))
    return cloud.chosen(shown).joined(copy.chosen(seen))


def _with_box(labels: LabelBoxes, box: FloatArray, like: int) -> LabelBoxes:
    return LabelBoxes(
        np.vstack([labels.boxes, box]),
        np.append(labels.positive, True),
        np.append(labels.moving, labels.moving[like]),
    )


def _elsewhere(
    box: FloatArray, farther: float, stretch: float, region: Region, rng: np.random.Generator
) -> FloatArray:
    """Return (N, 7) boxes turned about the sensor into the region, farther away, sides stretched.

    Their y is still the old one's; N is at most `_TURNS`.
    """
    turns = rng.uniform(-np.pi, np.pi, _TURNS)
    cos, sin = np.cos(turns) * farther, np.sin(turns) * farther
    x, z = box[0] * cos + box[2] * sin, box[2] * cos - box[0] * sin
    places = np.tile(box, (_TURNS, 1))
    places[:, 0], places[:, 2], places[:, 6] = x, z, box[6] + turns
    places[:, 3:6] *= rng.uniform(1 - stretch, 1 + stretch, 3)
    return places[region.cells(x, z)[1]]


def _free_floor(cloud: Cloud, box: FloatArray) -> float | None:
    """Return y of the ground where a box shall stand; None where something does or none is seen."""
    reach = max(np.hypot(box[3], box[4]) / 2 + _ROOM_M, _GROUND_REACH_M)
    close = np.abs(cloud.xyz[:, 0] - np.float32(box[0])) <= reach
    close &= np.abs(cloud.xyz[:, 2] - np.float32(box[2])) <= reach
    numbers = np.flatnonzero(close)
    xyz, ground = cloud.xyz.take(numbers, axis=0), cloud.ground[numbers]
    if not ground.any():
        return None
    tall = box.copy()
    tall[5] = 100.0
    if points_in_box(xyz[~ground], tall, _ROOM_M).any():
        return None
    return float(np.median(xyz[ground, 1]))


def _moved(own: Cloud, before: FloatArray, after: FloatArray) -> Cloud:
    """Return an object's points in another box, standing on its bottom."""
    feet = [box[:3] + np.array([0.0, box[5] / 2, 0.0]) for box in (before, after)]
    factors = (after[3:6] / before[3:6])[[0, 2, 1]]
    local = (own.xyz - feet[0]) @ yaw_rotation(before[6]) * factors
    xyz = (local @ yaw_rotation(after[6]).T + feet[1]).astype(np.float32)
    return replace(own, xyz=xyz, height_m=own.height_m * np.float32(factors[1]))


def _shadows(scene: Float32Array, copy: Float32Array) -> tuple[BoolArray, BoolArray]:
    """Return which points of a scene a copy leaves to be seen, and which of its own are."""
    turn, ranges, cells = _directions(copy)
    middle = float(turn[len(turn) // 2])
    shown = np.ones(len(scene), dtype=bool)
    reach = np.abs(_half_turn(turn - middle)).max() + _CELL_RAD[0]
    azimuth = np.arctan2(scene[:, 0], scene[:, 2])
    near = np.flatnonzero(np.abs(_half_turn(azimuth - middle)) <= reach)
    _, scene_ranges, scene_cells = _directions(scene[near])
    numbers, own = np.unique(cells, return_inverse=True)
    place = np.minimum(np.searchsorted(numbers, scene_cells), len(numbers) - 1)
    same = numbers[place] == scene_cells
    nearest = np.full(len(numbers), np.inf)
    np.minimum.at(nearest, own, ranges)
    shown[near] = ~(same & (scene_ranges > nearest[place] + _BEHIND_M))
    front = np.full(len(numbers), np.inf)
    np.minimum.at(front, place[same], scene_ranges[same])
    return shown, np.asarray(ranges <= front[own] + _BEHIND_M)


def _directions(xyz: Float32Array) -> tuple[Float32Array, Float32Array, IntArray]:
    """Return (N,) azimuths, ranges and cells of direction."""
    flat = np.hypot(xyz[:, 0], xyz[:, 2])
    azimuth = np.arctan2(xyz[:, 0], xyz[:, 2])
    column = np.floor(azimuth / _CELL_RAD[0]).astype(np.int64)
    line = np.floor(np.arctan2(xyz[:, 1], flat) / _CELL_RAD[1]).astype(np.int64)
    return azimuth, np.hypot(flat, xyz[:, 1]), column * 10_000 + line


def _half_turn(angle: NDArray[np.floating]) -> Float32Array:
    """Return angles brought to [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi, dtype=np.float32)
