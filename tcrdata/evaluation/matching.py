"""Greedy one-to-one matching of labels to labelled objects, surest label first."""

from __future__ import annotations

import numpy as np

from tcrdata.types import BoolArray, FloatArray, IntArray

UNMATCHED = -1


def match(overlap: FloatArray, scored: BoolArray, thresholds: FloatArray) -> IntArray:
    """Give each label the free object that it overlaps most, at each threshold on its own.

    An object that is scored serves one label. What remains may fall on an object that is not
    scored (hidden, or outside the region), and such an object takes any number of labels.

    Args:
        overlap: (N, M), rows from the surest label to the least sure.
        scored: (M,) which objects are scored.
        thresholds: (T,) smallest overlap of a match.

    Returns:
        (T, N) column of the object each label found, or UNMATCHED.
    """
    found = np.full((len(thresholds), len(overlap)), UNMATCHED, dtype=np.int64)
    if not overlap.size:
        return found
    free = np.broadcast_to(scored, (len(thresholds), len(scored))).copy()
    others = np.where(scored, -1.0, overlap)
    levels = np.arange(len(thresholds))
    for row in np.flatnonzero(overlap.max(axis=1) >= thresholds.min()):
        candidates = np.where(free, overlap[row], -1.0)
        best = candidates.argmax(axis=1)
        hit = candidates[levels, best] >= thresholds
        free[levels[hit], best[hit]] = False
        other = others[row].argmax()
        spare = np.where(others[row, other] >= thresholds, other, UNMATCHED)
        found[:, row] = np.where(hit, best, spare)
    return found
