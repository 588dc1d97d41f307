"""Where scripted objects stand over time, seen from above, and how far apart they stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from tcrdata.datasets.tabletop_scripts import Move, Script
from tcrdata.types import FloatArray

_SQUARE_COSINE = 0.9999
_FAR_M = 1e9
# Circles around two shapes that are farther apart than this say enough.
_CLEAR_M = 0.3


@dataclass(frozen=True)
class Footprints:
    """One object at T times: a rectangle, or a circle where it is round or tilting.

    Attributes:
        centre: (T, 3) metres, world.
        axes: (T, 2, 2) unit rows: the rectangle's sides.
        half_m: (T, 2) half sides, or the radius twice.
        round: (T,) whether it is a circle.
        half_height_m: (T,) half extent along z.
        bound_m: (T,) radius of a circle around it.
    """

    centre: FloatArray
    axes: FloatArray
    half_m: FloatArray
    round: FloatArray
    half_height_m: FloatArray
    bound_m: FloatArray


def footprints(script: Script, times_s: Sequence[float]) -> Footprints:
    """Return where an object stands at T times."""
    poses = np.array([script.pose(time_s) for time_s in times_s])
    rotation, half = poses[:, :3, :3], np.asarray(script.half_size_m)
    upright = np.abs(rotation[:, 2, :]).argmax(axis=1)
    square = np.abs(rotation[:, 2, :]).max(axis=1) > _SQUARE_COSINE
    level = np.array([[axis for axis in range(3) if axis != up] for up in upright])
    rows = np.arange(len(poses))[:, None]
    axes = np.swapaxes(rotation[:, :2, :], 1, 2)[rows, level]
    circle = (script.shape == "sphere") | (~square)
    if script.shape in ("cylinder", "cone"):
        circle |= upright == 2
    reach = np.where(square, half[level].max(axis=1), np.linalg.norm(half))
    if script.shape == "sphere":
        reach = np.full(len(poses), half[0])
    half_m = np.where(circle[:, None], reach[:, None], half[level])
    return Footprints(
        centre=poses[:, :3, 3],
        axes=axes,
        half_m=half_m,
        round=circle,
        half_height_m=np.abs(rotation[:, 2, :]) @ half,
        bound_m=np.where(circle, reach, np.hypot(half_m[:, 0], half_m[:, 1])),
    )


def moved(before: Footprints, script: Script, times_s: FloatArray, move: Move) -> Footprints:
    """Return where an object stands at (T,) times after a last move is put to its script.

    Args:
        before: where it stands at those times without the move.
        script: with the move.
        times_s: rising, the last no earlier than the move's start.
        move: the last one.
    """
    first = int(np.searchsorted(times_s, move.start_s))
    last = min(int(np.searchsorted(times_s, move.end_s)), len(times_s) - 1)
    during = footprints(script, times_s[first : last + 1].tolist())
    rows = np.minimum(np.arange(len(times_s) - first), last - first)
    return Footprints(
        **{
            field.name: np.concatenate(
                [getattr(before, field.name)[:first], getattr(during, field.name)[rows]]
            )
            for field in fields(Footprints)
        }
    )


def gap_m(one: Footprints, other: Footprints) -> float:
    """Return how near two objects come at any of the times, by separating axes.

    Negative where they overlap. Never more than the true distance; where one is above the other,
    they count as far apart.
    """
    offset = other.centre[:, :2] - one.centre[:, :2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    above = np.abs(other.centre[:, 2] - one.centre[:, 2]) - one.half_height_m - other.half_height_m
    around = np.where(above > 0, _FAR_M, distance - one.bound_m - other.bound_m)
    if around.min() > _CLEAR_M:
        return float(around.min())
    between = offset / np.maximum(distance, 1e-9)[:, None]
    candidates = [_along(between, offset, one, other)]
    for shape in (one, other):
        for side in range(2):
            gaps = _along(shape.axes[:, side], offset, one, other)
            candidates.append(np.where(shape.round, -_FAR_M, gaps))
    across = np.maximum.reduce(candidates)
    return float(np.where(above > 0, _FAR_M, across).min())


def _along(axis: FloatArray, offset: FloatArray, one: Footprints, other: Footprints) -> FloatArray:
    """(T,) the room between two shapes along (T, 2) unit axes."""
    apart = np.abs(axis[:, 0] * offset[:, 0] + axis[:, 1] * offset[:, 1])
    return np.asarray(apart - _reach(one, axis) - _reach(other, axis))


def _reach(shape: Footprints, axis: FloatArray) -> FloatArray:
    along, across = (
        np.abs(shape.axes[:, side, 0] * axis[:, 0] + shape.axes[:, side, 1] * axis[:, 1])
        for side in range(2)
    )
    sides = along * shape.half_m[:, 0] + across * shape.half_m[:, 1]
    return np.where(shape.round, shape.half_m[:, 0], sides)
