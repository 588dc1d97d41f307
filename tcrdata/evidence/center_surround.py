"""Center-surround saliency: does a region move unlike what lies around it?

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), eq. 10; the distance is that of Alexe
et al., "What is an object?" (CVPR 2010).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import points_in_box
from tcrdata.types import BoolArray, FloatArray


def histogram(values: NDArray[np.floating], bin_width: float, bins: int) -> FloatArray:
    """Return (bins,) shares of the values, 0 or more; the last bin holds all that is larger."""
    cells = np.minimum(values / bin_width, bins - 1).astype(np.int64)
    return np.bincount(cells, minlength=bins) / len(values)


def chi_square(a: FloatArray, b: FloatArray) -> float:
    """Return `1/2 sum (a - b)^2 / (a + b)` of two histograms of shares: 0 equal, 1 disjoint."""
    total = a + b
    used = total > 0
    return float(0.5 * (((a - b)[used] ** 2) / total[used]).sum())


def shell(
    xyz: NDArray[np.floating], region: BoolArray, box: NDArray[np.floating], margin_m: float
) -> BoolArray:
    """Return (N,): points within a margin of a (7,) box, in or around it, but not of the region."""
    return points_in_box(xyz, box, margin_m) & ~region


def center_surround(
    motion_m: NDArray[np.floating],
    center: BoolArray,
    surround: BoolArray,
    bin_width_m: float,
    bins: int,
) -> float | None:
    """Return the chi-square distance of |dXYZ| inside and around; None when either is empty.

    Args:
        motion_m: (N,) |dXYZ|, finite.
        center: (N,) points of the region.
        surround: (N,) points of the shell.
        bin_width_m: width of a bin of the histogram.
        bins: how many; the last is open.
    """
    if not center.any() or not surround.any():
        return None
    return chi_square(
        histogram(motion_m[center], bin_width_m, bins),
        histogram(motion_m[surround], bin_width_m, bins),
    )
