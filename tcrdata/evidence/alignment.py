"""How well a motion lays one sweep on another, and how far two motions differ on a sweep."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, FloatArray, IntArray


@compiled
def sort_by_cell(
    xyz: Float32Array, cell_m: float
) -> tuple[IntArray, IntArray, float, float, int, int]:
    """Sort points into columns of a grid seen from above (counting sort, stable).

    Returns:
        Indices of the points cell by cell, (cells + 1,) where each cell starts, the grid's corner
        (x, z), and its numbers of cells along x and z; cell = ix * nz + iz.
    """
    x0, z0, x1, z1 = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(xyz)):
        x0, x1 = min(x0, xyz[i, 0]), max(x1, xyz[i, 0])
        z0, z1 = min(z0, xyz[i, 2]), max(z1, xyz[i, 2])
    nx = int((x1 - x0) / cell_m) + 1
    nz = int((z1 - z0) / cell_m) + 1
    starts = np.zeros(nx * nz + 1, np.int64)
    cells = np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        cells[i] = int((xyz[i, 0] - x0) / cell_m) * nz + int((xyz[i, 2] - z0) / cell_m)
        starts[cells[i] + 1] += 1
    starts = np.cumsum(starts)
    fill = starts[:-1].copy()
    order = np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        order[fill[cells[i]]] = i
        fill[cells[i]] += 1
    return order, starts, x0, z0, nx, nz


@compiled
def _count_near(
    query: Float32Array,
    target: Float32Array,
    radius_m: float,
    cell_m: float,
    cells: tuple[IntArray, IntArray, float, float, int, int],
) -> int:
    order, starts, x0, z0, nx, nz = cells
    count = 0
    for q in range(len(query)):
        x, y, z = query[q, 0], query[q, 1], query[q, 2]
        ix0 = max(int(np.floor((x - radius_m - x0) / cell_m)), 0)
        ix1 = min(int(np.floor((x + radius_m - x0) / cell_m)), nx - 1)
        iz0 = max(int(np.floor((z - radius_m - z0) / cell_m)), 0)
        iz1 = min(int(np.floor((z + radius_m - z0) / cell_m)), nz - 1)
        found = False
        if iz1 < iz0:
            continue
        for ix in range(ix0, ix1 + 1):
            for k in range(starts[ix * nz + iz0], starts[ix * nz + iz1 + 1]):
                dx = target[order[k], 0] - x
                dy = target[order[k], 1] - y
                dz = target[order[k], 2] - z
                if dx * dx + dy * dy + dz * dz <= radius_m * radius_m:
                    found = True
                    break
            if found:
                break
        count += found
    return count


def share_with_neighbour(
    query: NDArray[np.floating], target: NDArray[np.floating], radius_m: float
) -> float | None:
    """Return the share of (N, 3) points with one of (M, 3) points within a radius.

    Returns:
        None when either cloud is empty.
    """
    (share,) = shares_with_neighbour([query], target, radius_m)
    return share


def shares_with_neighbour(
    queries: Iterable[NDArray[np.floating]], target: NDArray[np.floating], radius_m: float
) -> list[float | None]:
    """Return what `share_with_neighbour` gives for each cloud, with the target sorted once."""
    if not len(target):
        return [None for _ in queries]
    there, cell_m = np.ascontiguousarray(target, dtype=np.float32), 4 * radius_m
    cells = sort_by_cell(there, cell_m)
    shares: list[float | None] = []
    for query in queries:
        here = np.ascontiguousarray(query, dtype=np.float32)
        near = _count_near(here, there, radius_m, cell_m, cells) if len(here) else 0
        shares.append(float(near) / len(here) if len(here) else None)
    return shares


@compiled
def _largest_square(xyz: Float32Array, A: FloatArray, b: FloatArray) -> float:
    largest = 0.0
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        dx = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + b[0]
        dy = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + b[1]
        dz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + b[2]
        largest = max(largest, dx * dx + dy * dy + dz * dz)
    return largest


def cycle_error(xyz: Float32Array, to_T_from: FloatArray, from_T_to: FloatArray) -> float:
    """Return `max |backward(forward(x)) - x|` over (N, 3) points, metres (eq. 6 and 7)."""
    cycle = from_T_to @ to_T_from
    A = np.ascontiguousarray(cycle[:3, :3] - np.eye(3))
    return float(np.sqrt(_largest_square(xyz, A, np.ascontiguousarray(cycle[:3, 3]))))
