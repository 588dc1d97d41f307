"""Votes of other sweeps on a point: was its place free, the same surface, or hidden then?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.range_images import RangeGrid, RangeImage, cells_of
from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, FloatArray, ImageArray


@compiled
def _vote(
    nearest: Float32Array, cell: int, stride: int, low: np.float32, high: np.float32, least_far: int
) -> int:
    """Return 0 free, 1 static, 2 occluded, 3 none, from the 3x3 window around a cell."""
    nearer, farther = 0, 0
    for row in (-stride, 0, stride):
        for column in (-1, 0, 1):
            value = nearest[cell + row + column]
            if value < low:
                nearer += 1
            elif value <= high:
                return 1
            elif value < np.inf:
                farther += 1
    if nearer > 0:
        return 2
    return 0 if farther >= least_far else 3


@compiled
def _tally(
    cells: NDArray[np.int32],
    ranges: Float32Array,
    image: Float32Array,
    window: Float32Array,
    margin_m: np.float32,
    margin_share: np.float32,
    least_far: int,
    votes: ImageArray,
) -> None:
    nearest, nearest_around, stride = image.ravel(), window.ravel(), image.shape[1]
    for i in range(cells.size):
        around = nearest_around[cells[i]]
        if around == np.inf:
            continue
        margin = margin_m + margin_share * ranges[i]
        low, high = ranges[i] - margin, ranges[i] + margin
        # The nearest return of the window settles most votes without a look at all nine cells.
        if around >= low and around <= high:
            kind = 1
        else:
            kind = _vote(nearest, cells[i], stride, low, high, least_far)
        if kind < 3 and votes[kind, i] < 255:
            votes[kind, i] += 1


def add_votes(
    votes: ImageArray,
    points: Float32Array,
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
        points: (3, N) x, y, z, contiguous, in the level frame of their own frame.
        image: the other sweep.
        grid: the other sweep's directions.
        other_T_level: (4, 4) from the points' level frame to the other's.
        margin_m: see above.
        margin_share: see above.
        least_far: see above.
    """
    sensor_T_other = np.eye(4)
    sensor_T_other[:3] = grid.sensor_T_level
    sensor_T_points = (sensor_T_other @ other_T_level)[:3].astype(np.float32)
    cells, ranges = cells_of(points, np.ascontiguousarray(sensor_T_points), grid)
    _tally(
        cells,
        ranges,
        image.nearest_m,
        image.window_m,
        np.float32(margin_m),
        np.float32(margin_share),
        least_far,
        votes,
    )
