"""Height of points above the local ground: a grid of ground cells, or a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array, FloatArray


@compiled
def _cell_sums(
    xyz: Float32Array, ground: BoolArray, cell_m: float, half: int
) -> tuple[FloatArray, FloatArray]:
    """Return the (2 half, 2 half) sums of y and the numbers of ground points, by (x, z) cell."""
    sums = np.zeros((2 * half, 2 * half))
    counts = np.zeros((2 * half, 2 * half))
    for i in range(len(xyz)):
        if ground[i]:
            a = int(np.floor(xyz[i, 0] / cell_m)) + half
            b = int(np.floor(xyz[i, 2] / cell_m)) + half
            if 0 <= a < 2 * half and 0 <= b < 2 * half:
                sums[a, b] += xyz[i, 1]
                counts[a, b] += 1.0
    return sums, counts


@compiled
def _heights(xyz: Float32Array, ground_y: FloatArray, cell_m: float) -> Float32Array:
    """Return (N,) heights over the cells' levels, interpolated between cell centres."""
    result = np.empty(len(xyz), np.float32)
    size = len(ground_y)
    half = size // 2
    for i in range(len(xyz)):
        a = min(max(xyz[i, 0] / cell_m + half - 0.5, 0.0), size - 1.0)
        b = min(max(xyz[i, 2] / cell_m + half - 0.5, 0.0), size - 1.0)
        a0 = min(int(a), size - 2)
        b0 = min(int(b), size - 2)
        u, v = a - a0, b - b0
        level = (1 - u) * ((1 - v) * ground_y[a0, b0] + v * ground_y[a0, b0 + 1]) + u * (
            (1 - v) * ground_y[a0 + 1, b0] + v * ground_y[a0 + 1, b0 + 1]
        )
        result[i] = level - xyz[i, 1]
    return result


def heights_above_cells(
    xyz: Float32Array, ground: BoolArray, *, cell_m: float, reach_m: float
) -> Float32Array:
    """Return (N,) heights in metres above the mean level of the ground points nearby.

    Cells without ground take the nearest cell's level; levels are interpolated bilinearly.

    Args:
        xyz: (N, 3) points, level frame (y down).
        ground: (N,) which points are ground.
        cell_m: side of a cell.
        reach_m: half side of the square of cells; farther points take its border's level.

    Returns:
        (N,) float32; NaN when no ground point lies within reach.
    """
    from scipy import ndimage

    half = max(int(np.ceil(reach_m / cell_m)), 1)
    sums, counts = _cell_sums(xyz, ground, cell_m, half)
    empty = counts == 0
    if empty.all():
        return np.full(len(xyz), np.nan, np.float32)
    ground_y = sums / np.where(empty, 1.0, counts)
    nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
    result: Float32Array = _heights(xyz, ground_y[nearest[0], nearest[1]], cell_m)
    return result


def plane_heights(xyz: NDArray[np.floating], plane: FloatArray) -> Float32Array:
    """Return (N,) heights `a x + b z + c - y` above the plane (a, b, c) of the level frame."""
    level = xyz[:, 0] * plane[0] + xyz[:, 2] * plane[1] + plane[2]
    return np.asarray(level - xyz[:, 1], dtype=np.float32)
