"""The points of a sweep on their way to a sample, and whose they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import points_in_box
from tcrdata.networks.center_targets import LabelBoxes
from tcrdata.types import BoolArray, Float32Array, IntArray

NOBODY = -1
"""Owner of a point that lies in no positive label."""

_MARGIN_M = 0.1


@dataclass(frozen=True)
class Cloud:
    """The points of a sweep, metres of a road scene, and where each came from.

    Attributes:
        xyz: (N, 3) level frame.
        height_m: (N,) above the ground; NaN where unknown.
        ground: (N,) whether each is ground.
        origin: (N,) number of the sweep's point that it is, or is a copy of.
        owner: (N,) number of the positive label whose point it is; see `owners`.
    """

    xyz: Float32Array
    height_m: Float32Array
    ground: BoolArray
    origin: IntArray
    owner: IntArray

    def chosen(self, which: NDArray[np.bool_ | np.integer]) -> Cloud:
        """Return some of the points, by a mask or by their numbers."""
        numbers = np.flatnonzero(which) if which.dtype == bool else which
        # Rows are taken several times as fast as indexing gives them.
        names = self.__dataclass_fields__
        return Cloud(*(getattr(self, name).take(numbers, axis=0) for name in names))

    def joined(self, other: Cloud) -> Cloud:
        """Return the points of both."""
        names = self.__dataclass_fields__
        return Cloud(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


def owners(xyz: Float32Array, ground: BoolArray, labels: LabelBoxes) -> IntArray:
    """Return (N,) the number of the positive label whose point each is, or `NOBODY`.

    Ground is nobody's; what lies in several boxes is of the first: the surest.
    """
    owner = np.full(len(xyz), NOBODY, dtype=np.int64)
    solid = np.flatnonzero(~ground)
    standing = xyz.take(solid, axis=0)
    for number in np.flatnonzero(labels.positive & np.isfinite(labels.boxes).all(axis=1))[::-1]:
        owner[solid[points_in_box(standing, labels.boxes[number], _MARGIN_M)]] = number
    return owner


def points_of_labels(owner: IntArray, labels: int) -> IntArray:
    """Return (labels,) how many of the points with these owners each label has."""
    return np.bincount(owner[owner != NOBODY], minlength=labels)


def still_shown(left: IntArray, whole: IntArray, most_gone: float) -> bool:
    """Whether every label that had points keeps more than the share 1 - most_gone of them.

    Args:
        left: (M,) points of each label now.
        whole: (M,) points of each before anything was hidden.
        most_gone: share of a label's points, all that hides it taken together.
    """
    return bool(np.all((left > (1 - most_gone) * whole) | (whole == 0)))
