"""A frame's points, sorted into cells of the ground plane: what is near a box is found at once.

Which points are found, in which order, and where they lie in a box's axes are the very bits of a
pass over all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, FloatArray

Indices = NDArray[np.int64]
Numbers = NDArray[np.int32]
_SIDES = 64
_SLACK = 1e-3  # of a cell: the ends of a search are rounded


@dataclass(frozen=True)
class CellPoints:
    """Points with an index.

    Attributes:
        xyz: (N, 3) float32, world.
        order: (N,) numbers of the points, cell by cell, rising within one.
        starts: where each cell's begin in `order`, and the end; cells along z follow one another.
        low: (2,) least x and z.
        cells_a_metre: along either.
    """

    xyz: Float32Array
    order: Numbers
    starts: Numbers
    low: FloatArray
    cells_a_metre: float

    def __len__(self) -> int:
        return len(self.xyz)


def cell_points(xyz: Float32Array) -> CellPoints:
    """Return (N, 3) points with an index of 64 x 64 cells over their extent."""
    low, extent = _extent(xyz)
    cells_a_metre = (_SIDES - 1) / max(extent, 1e-6)
    order, starts = _sorted(xyz, low, cells_a_metre)
    return CellPoints(xyz, order, starts, low, cells_a_metre)


@compiled
def _extent(xyz: Float32Array) -> tuple[FloatArray, float]:
    """Return the least x and z of points, and how far they reach along the longer way."""
    x, z = (xyz[0, 0], xyz[0, 2]) if len(xyz) else (np.float32(0), np.float32(0))
    right, far = x, z
    for i in range(len(xyz)):
        x, right = min(x, xyz[i, 0]), max(right, xyz[i, 0])
        z, far = min(z, xyz[i, 2]), max(far, xyz[i, 2])
    low = np.array([np.float64(x), np.float64(z)])
    return low, max(right - low[0], far - low[1])


@compiled
def _sorted(xyz: Float32Array, low: FloatArray, cells_a_metre: float) -> tuple[Numbers, Numbers]:
    """Return the points' numbers by cell, and where each cell begins: a counting sort."""
    starts = np.zeros(_SIDES * _SIDES + 1, np.int32)
    cells = np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        u, w = (xyz[i, 0] - low[0]) * cells_a_metre, (xyz[i, 2] - low[1]) * cells_a_metre
        cells[i] = np.int32(u) * _SIDES + np.int32(w)
        starts[cells[i] + 1] += 1
    for n in range(_SIDES * _SIDES):
        starts[n + 1] += starts[n]
    free = starts.copy()
    order = np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        order[free[cells[i]]] = i
        free[cells[i]] += 1
    return order, starts


def near(box: FloatArray, points: CellPoints, half: FloatArray) -> tuple[Indices, FloatArray]:
    """Return which points lie within half sizes of a box's centre, and where in its axes.

    Args:
        box: (7,), world.
        points: N of them.
        half: (3,) along the length, down, and across.

    Returns:
        (M,) rising numbers of points; (M, 3) metres from the centre along, down, and across.
    """
    reach = float(np.hypot(half[0], half[2]))
    c, s = math.cos(box[6]), math.sin(box[6])
    found = _found(
        points.xyz, points.order, points.starts, points.low, points.cells_a_metre, box, half,
        reach, c, s,
    )  # fmt: skip
    found.sort()
    return found, _placed(points.xyz, found, box, c, s)


def number_inside(points: CellPoints, box: FloatArray) -> int:
    """Return how many points lie in a (7,) box."""
    half = box[[3, 5, 4]] / 2
    c, s = math.cos(box[6]), math.sin(box[6])
    return len(
        _found(
            points.xyz, points.order, points.starts, points.low, points.cells_a_metre, box, half,
            math.hypot(half[0], half[2]), c, s,
        )
    )  # fmt: skip


@compiled
def _found(
    xyz: Float32Array,
    order: Numbers,
    starts: Numbers,
    low: FloatArray,
    cells_a_metre: float,
    box: FloatArray,
    half: FloatArray,
    reach: float,
    c: float,
    s: float,
) -> Indices:
    """Return the numbers of the points within half sizes, cell by cell."""
    first, last = _span(box[0] - low[0], reach, cells_a_metre)
    front, back = _span(box[2] - low[1], reach, cells_a_metre)
    most = 0
    for u in range(first, last):
        most += starts[u * _SIDES + back] - starts[u * _SIDES + front]
    found = np.empty(most, np.int64)
    count = 0
    for u in range(first, last):
        for n in range(starts[u * _SIDES + front], starts[u * _SIDES + back]):
            i = order[n]
            dx = xyz[i, 0] - box[0]
            if not abs(dx) <= reach:
                continue
            dz = xyz[i, 2] - box[2]
            dy = xyz[i, 1] - box[1]
            if not (abs(dz) <= reach and abs(dy) <= half[1]):
                continue
            if abs(c * dx - s * dz) <= half[0] and abs(s * dx + c * dz) <= half[2]:
                found[count] = i
                count += 1
    return found[:count].copy()


@compiled
def _span(centre: float, reach: float, cells_a_metre: float) -> tuple[int, int]:
    """Return the first cell that comes within reach of a place, and the one after the last."""
    first = np.floor((centre - reach) * cells_a_metre - _SLACK)
    last = np.floor((centre + reach) * cells_a_metre + _SLACK) + 1
    if not (first < _SIDES and last > 0):
        return 0, 0
    return int(max(first, 0)), int(min(last, _SIDES))


@compiled
def _placed(xyz: Float32Array, found: Indices, box: FloatArray, c: float, s: float) -> FloatArray:
    """Return where points lie in a box's axes."""
    local = np.empty((len(found), 3))
    for n in range(len(found)):
        i = found[n]
        dx, dz = xyz[i, 0] - box[0], xyz[i, 2] - box[2]
        local[n, 0] = c * dx - s * dz
        local[n, 1] = xyz[i, 1] - box[1]
        local[n, 2] = s * dx + c * dz
    return local
