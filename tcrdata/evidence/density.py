"""Density clusters of points: DBSCAN (Ester et al., KDD 1996) on a grid, the same on every run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.alignment import sort_by_cell
from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, IntArray

Index = int | np.signedinteger[Any]


@compiled
def _root(parents: IntArray, i: Index) -> Index:
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled
def _square(xyz: Float32Array, i: int, j: int) -> float:
    dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def _core_points(
    xyz: Float32Array, cells: IntArray, starts: IntArray, nz: int, eps_m: float, enough: int
) -> NDArray[np.bool_]:
    """Return (N,) whether a point has enough points within eps, itself counted."""
    nx = (len(starts) - 1) // nz
    core = np.zeros(len(xyz), np.bool_)
    for i in range(len(xyz)):
        ix, iz = cells[i] // nz, cells[i] % nz
        count = 0
        for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
            first = starts[jx * nz + max(iz - 1, 0)]
            last = starts[jx * nz + min(iz + 1, nz - 1) + 1]
            for j in range(first, last):
                count += _square(xyz, i, j) <= eps_m * eps_m
                if count >= enough:
                    break
            if count >= enough:
                core[i] = True
                break
    return core


@compiled
def _connected(
    xyz: Float32Array, cells: IntArray, starts: IntArray, nz: int, eps_m: float, enough: int
) -> IntArray:
    """Return (N,) the representative of each point's cluster, -1 for noise."""
    nx = (len(starts) - 1) // nz
    core = _core_points(xyz, cells, starts, nz, eps_m, enough)
    parents = np.arange(len(xyz))
    core_of = np.full(len(xyz), -1)
    nearest = np.full(len(xyz), eps_m * eps_m)
    for i in range(len(xyz)):
        if not core[i]:
            continue
        ix, iz = cells[i] // nz, cells[i] % nz
        for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
            first = starts[jx * nz + max(iz - 1, 0)]
            last = starts[jx * nz + min(iz + 1, nz - 1) + 1]
            for j in range(first, last):
                if core[j]:
                    if j < i and parents[i] != parents[j] and _square(xyz, i, j) <= eps_m * eps_m:
                        a, b = _root(parents, i), _root(parents, j)
                        parents[max(a, b)] = min(a, b)
                else:
                    square = _square(xyz, i, j)
                    if square < nearest[j] or (square == nearest[j] and core_of[j] < 0):
                        nearest[j], core_of[j] = square, i
    labels = np.full(len(xyz), -1)
    for i in range(len(xyz)):
        anchor: Index = i if core[i] else core_of[i]
        if anchor >= 0:
            labels[i] = _root(parents, anchor)
    return labels


def density_clusters(
    xyz: NDArray[np.floating],
    *,
    eps_m: float,
    vertical_share: float,
    minimum_neighbours: int,
    minimum_points: int,
) -> list[IntArray]:
    """Return the clusters of (N, 3) level points, as rising indices; noise belongs to none.

    A border point joins the cluster of its nearest core point.

    Args:
        xyz: metres.
        eps_m: neighbours are this near.
        vertical_share: vertical distances count this much.
        minimum_neighbours: core points have so many points within eps, themselves counted.
        minimum_points: smaller clusters are left out.

    Returns:
        Clusters in the order of their first points.
    """
    if not len(xyz):
        return []
    points = np.asarray(xyz, dtype=np.float32) * np.array([1, vertical_share, 1], np.float32)
    order, starts, _, _, _, nz = sort_by_cell(points, eps_m)
    cells = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    labels = np.empty(len(points), np.int64)
    labels[order] = _connected(points[order], cells, starts, nz, eps_m, minimum_neighbours)
    members = np.argsort(labels, kind="stable")
    cuts = np.flatnonzero(np.diff(labels[members])) + 1
    groups = [g for g in np.split(members, cuts) if labels[g[0]] >= 0 and len(g) >= minimum_points]
    return sorted(groups, key=lambda group: int(group[0]))
