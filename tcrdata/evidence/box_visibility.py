"""Where what was seen of an object ends because something nearer hides the rest."""

from __future__ import annotations

import math

import numpy as np

from tcrdata.evidence.range_images import RangeGrid, RangeImage, locate
from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array, FloatArray

_UNKNOWN, _CLEAR, _HIDDEN, _OUTSIDE = 0, 1, 2, 3
_STEPS_M = np.array([0.3, 0.6])
_EDGE_POINTS = 16


@compiled
def _look(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    T: Float32Array,
    window: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margins: FloatArray,
) -> int:
    """Return whether a level place is _UNKNOWN, _CLEAR, _HIDDEN or _OUTSIDE.

    Hidden: the 3x3 window has a return nearer than `r - margin_m - margin_share r`.
    """
    row, column, distance = locate(
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
        spherical,
        window.shape[0] - 2,
        window.shape[1] - 2,
        numbers,
    )
    if row < 0:
        return _OUTSIDE
    if window[row, column] == np.inf:
        return _UNKNOWN
    nearer = window[row, column] < distance - margins[0] - margins[1] * distance
    return _HIDDEN if nearer else _CLEAR


@compiled
def _hidden_edges(
    xyz: Float32Array,
    box: FloatArray,
    steps_m: FloatArray,
    T: Float32Array,
    window: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margins: FloatArray,
) -> BoolArray:
    c, s = math.cos(box[6]), math.sin(box[6])
    hidden = np.zeros(4, np.bool_)
    offsets = np.empty(len(xyz))
    for edge in range(4):
        # Rear, front, low side, high side: an axis, and which way along it.
        sense = -1.0 if edge % 2 == 0 else 1.0
        axis_x, axis_z = (c, -s) if edge < 2 else (s, c)
        for i in range(len(xyz)):
            dx, dz = xyz[i, 0] - np.float32(box[0]), xyz[i, 2] - np.float32(box[2])
            offsets[i] = sense * (dx * np.float32(axis_x) + dz * np.float32(axis_z))
        ends = np.flatnonzero(offsets >= offsets.max() - steps_m[0])
        lost, known = 0, 0
        for i in ends[:: max(1, len(ends) // _EDGE_POINTS)]:
            for step_m in steps_m:
                x = np.float32(xyz[i, 0] + sense * step_m * axis_x)
                z = np.float32(xyz[i, 2] + sense * step_m * axis_z)
                kind = _look(x, xyz[i, 1], z, T, window, spherical, numbers, margins)
                # A depth image ends at its border: what lies beyond cannot be seen either.
                gone = kind == _HIDDEN or (kind == _OUTSIDE and not spherical)
                lost += gone
                known += gone or kind == _CLEAR
        hidden[edge] = 2 * lost > known
    return hidden


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
    them, and looks whether most of those places are hidden, or outside a depth image. A place is
    hidden where the 3x3 window has a return nearer than `r - margin_m - margin_share r`.
    """
    found: BoolArray = _hidden_edges(
        np.ascontiguousarray(xyz, dtype=np.float32),
        box,
        _STEPS_M * metric_scale,
        grid.sensor_T_level,
        image.window_m,
        grid.spherical,
        grid.numbers,
        np.array([margin_m, margin_share]),
    )
    return found
