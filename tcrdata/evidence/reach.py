"""Points that are no ground and lie within a sensor's reach."""

from __future__ import annotations

import numpy as np

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array, FloatArray, IntArray


@compiled
def _within(
    xyz: Float32Array,
    ground: BoolArray,
    sensor: Float32Array,
    nearest_square: np.float32,
    furthest_square: np.float32,
) -> IntArray:
    found = np.empty(len(xyz), np.int64)
    count = 0
    for i in range(len(xyz)):
        dx, dy, dz = xyz[i, 0] - sensor[0], xyz[i, 1] - sensor[1], xyz[i, 2] - sensor[2]
        square = (dx * dx + dy * dy) + dz * dz
        # Written whatever it is, and counted if it is one: no branch to guess.
        found[count] = i
        count += (not ground[i]) & (square >= nearest_square) & (square <= furthest_square)
    return found[:count].copy()


def solid_within(
    xyz: Float32Array, ground: BoolArray, sensor: FloatArray, nearest_m: float, furthest_m: float
) -> IntArray:
    """Return the indices, rising, of those of (N, 3) points that are solid and within reach.

    Args:
        xyz: level frame.
        ground: (N,) which points are ground.
        sensor: (3,) its place, level frame.
        nearest_m: nearer points are left out.
        furthest_m: and farther ones.
    """
    near, far = np.float32(nearest_m**2), np.float32(furthest_m**2)
    return _within(np.ascontiguousarray(xyz), ground, sensor.astype(np.float32), near, far)
