"""Where what was seen of an object ends because something nearer hides the rest."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.range_images import RangeGrid, RangeImage, locate
from tcrdata.geometry.boxes import box_coordinates
from tcrdata.types import BoolArray, Float32Array, FloatArray, IntArray

UNKNOWN, CLEAR, HIDDEN, OUTSIDE = 0, 1, 2, 3
# Rear, front, low side, high side: the axis (0 length, 1 width) and the sense of each edge.
_EDGES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))
_STEPS_M = (0.3, 0.6)
_EDGE_POINTS = 16


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _look(
    xyz: Float32Array,
    T: Float32Array,
    window: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margin_m: float,
    margin_share: float,
) -> IntArray:
    rows, columns = window.shape[0] - 2, window.shape[1] - 2
    result = np.zeros(len(xyz), np.int64)
    for i in range(len(xyz)):
        px, py, pz = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        row, column, distance = locate(x, y, z, spherical, rows, columns, numbers)
        if row < 0:
            result[i] = 3
        elif window[row, column] < np.inf:
            nearer = window[row, column] < distance - margin_m - margin_share * distance
            result[i] = 2 if nearer else 1
    return result


def look(
    xyz: NDArray[np.floating],
    image: RangeImage,
    grid: RangeGrid,
    margin_m: float,
    margin_share: float,
) -> IntArray:
    """Return for each of (N, 3) level places whether it is UNKNOWN, CLEAR, HIDDEN or OUTSIDE.

    Hidden: the 3x3 window has a return nearer than `r - margin_m - margin_share r`.
    """
    result: IntArray = _look(
        np.ascontiguousarray(xyz, dtype=np.float32),
        grid.sensor_T_level,
        image.window_m,
        grid.spherical,
        grid.numbers,
        margin_m,
        margin_share,
    )
    return result


def hidden_edges(
    xyz: Float32Array,
    box: FloatArray,
    image: RangeImage,
    grid: RangeGrid,
    margin_m: float,
    margin_share: float,
    metric_scale: float,
) -> BoolArray:
    """Return (4,) which ends of (N, 3) seen points hide behind something nearer.

    Takes the points at each end of the box's axes (rear, front, low and high side), steps past
    them, and looks whether most of those places are hidden, or outside a depth image.
    """
    local = box_coordinates(xyz[:, [0, 2]], box)
    axes = _level_axes(float(box[6]))
    beyond = []
    for axis, sense in _EDGES:
        along = sense * local[:, axis]
        ends = np.flatnonzero(along >= along.max() - _STEPS_M[0] * metric_scale)
        ends = ends[:: max(1, len(ends) // _EDGE_POINTS)]
        beyond += [xyz[ends] + sense * s * metric_scale * axes[axis] for s in _STEPS_M]
    seen = look(np.concatenate(beyond), image, grid, margin_m, margin_share)
    # A depth image ends at its border: what lies beyond cannot be seen either.
    lost = (seen == HIDDEN) | ((seen == OUTSIDE) & (not grid.spherical))
    known = lost | (seen == CLEAR)
    starts = np.cumsum([0, *(len(places) for places in beyond)])[:-1:2]
    return np.asarray(
        2 * np.add.reduceat(lost, starts, dtype=int) > np.add.reduceat(known, starts, dtype=int)
    )


def _level_axes(yaw: float) -> FloatArray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, 0.0, -s], [s, 0.0, c]])
