"""Votes of other sweeps on a point: was its place free, the same surface, or hidden then?"""

from __future__ import annotations

import numba
import numpy as np

from tcrdata.evidence.range_images import RangeGrid, RangeImage, locate, range_image
from tcrdata.types import Float32Array, FloatArray, ImageArray


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _vote(
    nearest: Float32Array,
    row: int,
    column: int,
    low: np.float32,
    high: np.float32,
    least_far: int,
) -> int:
    """Return 0 free, 1 static, 2 occluded, 3 none, from the 3x3 window around a cell."""
    nearer, farther = 0, 0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            value = nearest[r, c]
            if value < low:
                nearer += 1
            elif value <= high:
                return 1
            elif value < np.inf:
                farther += 1
    if nearer > 0:
        return 2
    return 0 if farther >= least_far else 3


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_votes(
    xyz: Float32Array,
    T: Float32Array,
    nearest: Float32Array,
    window: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margin_m: np.float32,
    margin_share: np.float32,
    least_far: int,
    votes: ImageArray,
) -> None:
    """Add one sweep's votes, in place, to (3, N) uint8: free, static, occluded."""
    rows, columns = nearest.shape[0] - 2, nearest.shape[1] - 2
    for i in range(len(xyz)):
        px, py, pz = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        row, column, distance = locate(x, y, z, spherical, rows, columns, numbers)
        if row < 0:
            continue
        margin = margin_m + margin_share * distance
        first = window[row, column]
        # The nearest return of the window settles most votes without a look at all nine cells.
        if first == np.inf:
            continue
        if first >= distance - margin and first <= distance + margin:
            kind = 1
        else:
            kind = _vote(nearest, row, column, distance - margin, distance + margin, least_far)
        if kind < 3 and votes[kind, i] < 255:
            votes[kind, i] += 1


def add_votes(
    votes: ImageArray,
    xyz: Float32Array,
    image: RangeImage,
    grid: RangeGrid,
    other_T_level: FloatArray,
    *,
    margin_m: float,
    margin_share: float,
    least_far: int,
) -> None:
    """Add another sweep's votes on some points.

    With r the point's range in the other sweep, m = margin_m + margin_share r, and the returns d
    of the 3x3 window: static when any |d - r| <= m; else occluded when any d < r - m; else free
    when at least `least_far` d > r + m.

    Args:
        votes: (3, N) uint8, changed in place: free, static, occluded; stops at 255.
        xyz: (N, 3) points in the level frame of their own frame.
        image: the other sweep.
        grid: the other sweep's directions.
        other_T_level: (4, 4) from the points' level frame to the other's.
        margin_m: see above.
        margin_share: see above.
        least_far: see above.
    """
    sensor = np.eye(4)
    sensor[:3] = grid.sensor_T_level
    _add_votes(
        xyz,
        np.ascontiguousarray((sensor @ other_T_level)[:3].astype(np.float32)),
        image.nearest_m,
        image.window_m,
        grid.spherical,
        grid.numbers,
        np.float32(margin_m),
        np.float32(margin_share),
        least_far,
        votes,
    )


def compile_kernels(grid: RangeGrid) -> None:
    """Compile once and cache on disk, so that worker processes only load machine code."""
    point = np.zeros((1, 3), np.float32)
    image = range_image(point, grid)
    add_votes(
        np.zeros((3, 1), np.uint8),
        point,
        image,
        grid,
        np.eye(4),
        margin_m=1.0,
        margin_share=0.0,
        least_far=2,
    )
