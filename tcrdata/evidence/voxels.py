"""Sparse voxels: where points fall, and which voxels touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.types import BoolArray, IntArray

# Voxels within +-2^20 of the origin on each axis: +-131 km at 0.125 m.
_BITS = 21
_OFFSET = 1 << (_BITS - 1)
_NEIGHBOURS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], dtype=np.int64
)


def voxel_indices(xyz: NDArray[np.floating], size_m: float) -> IntArray:
    """Return the (N, 3) whole-number voxels of (N, 3) points; voxel 0 begins at the origin."""
    return np.floor(xyz.astype(np.float64) / size_m).astype(np.int64)


def keys(voxels: IntArray) -> IntArray:
    """Return one number a voxel, (N,), that sorts by x, then y, then z."""
    shifted = voxels + _OFFSET
    packed: IntArray = (shifted[:, 0] << 2 * _BITS) | (shifted[:, 1] << _BITS) | shifted[:, 2]
    return packed


def from_keys(packed: IntArray) -> IntArray:
    """Return the (N, 3) voxels of (N,) keys."""
    low = (1 << _BITS) - 1
    axes = (packed >> 2 * _BITS, (packed >> _BITS) & low, packed & low)
    return np.stack(axes, axis=1) - _OFFSET


def is_in(packed: IntArray, others: IntArray) -> BoolArray:
    """Return (N,): which keys are among the others, which are sorted and unique."""
    if not len(others):
        return np.zeros(len(packed), dtype=bool)
    place = np.minimum(np.searchsorted(others, packed), len(others) - 1)
    return np.asarray(others[place] == packed)


def touching(packed: IntArray, others: IntArray) -> BoolArray:
    """Return (N,): which keys are among the others grown by one voxel on every side.

    Args:
        packed: (N,) keys.
        others: sorted and unique keys.
    """
    grown = from_keys(packed)[:, None, :] + _NEIGHBOURS[None, :, :]
    found = is_in(keys(grown.reshape(-1, 3)), others).reshape(-1, len(_NEIGHBOURS))
    return np.asarray(found.any(axis=1))


def components(packed: IntArray) -> IntArray:
    """Label (N,) sorted unique keys by connected component: faces, edges and corners connect.

    Returns:
        (N,) labels from 0, in the order in which the components first occur.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(packed):
        return np.empty(0, dtype=np.int64)
    voxels = from_keys(packed)
    starts, stops = [], []
    # Half of the neighbours are enough: a pair is found from either of its ends.
    for step in _NEIGHBOURS[len(_NEIGHBOURS) // 2 + 1 :]:
        beside = keys(voxels + step)
        place = np.minimum(np.searchsorted(packed, beside), len(packed) - 1)
        touching = np.flatnonzero(packed[place] == beside)
        starts.append(touching)
        stops.append(place[touching])
    rows, columns = np.concatenate(starts), np.concatenate(stops)
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(packed),) * 2)
    labels = connected_components(graph, directed=False)[1]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[inverse], dtype=np.int64)
