"""Scores of optical flow: endpoint error, outliers, and what the cycle test tells of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from tcrdata.types import BoolArray, Float32Array

OUTLIER_PX = 3.0
OUTLIER_SHARE = 0.05
MOVING_PX = 0.5
PROTOCOL = (
    "endpoint error |w - w_true| in px, over the pixels with known flow; outliers (KITTI Fl): more "
    f"than {OUTLIER_PX:g} px and more than {100 * OUTLIER_SHARE:g} % of |w_true|;\n"
    "consistent: |w + w''|^2 < 0.05 (|w|^2 + |w''|^2) + 0.5 (eq. 5), over all pixels; "
    "then the error there, elsewhere,\n"
    f"and where |w_true| is {MOVING_PX:g} px and more (moving); zeros: what a flow of zeros scores;"
    " several flows: every pixel counts alike"
)


@dataclass(frozen=True)
class FlowScore:
    """Sums over pixels, so that scores add up.

    Attributes:
        pixels: of the flows.
        consistent: of these, pass the cycle test.
        known: pixels with known flow.
        known_consistent: of these, pass the cycle test.
        outliers: pixels with known flow that KITTI counts as wrong.
        error_px: sum of endpoint errors over the known pixels.
        error_consistent_px: the same, over those that pass the cycle test.
        moving: pixels with known flow of MOVING_PX and more.
        error_moving_px: sum of endpoint errors over these.
        length_px: sum of |w_true|, which is what a flow of zeros errs by.
        length_moving_px: the same, over the moving pixels.
        long: pixels at which a flow of zeros would be an outlier.
    """

    pixels: int = 0
    consistent: int = 0
    known: int = 0
    known_consistent: int = 0
    outliers: int = 0
    error_px: float = 0.0
    error_consistent_px: float = 0.0
    moving: int = 0
    error_moving_px: float = 0.0
    length_px: float = 0.0
    length_moving_px: float = 0.0
    long: int = 0

    @property
    def consistent_share(self) -> float | None:
        """Share of all pixels that pass the cycle test."""
        return _ratio(self.consistent, self.pixels)

    @property
    def outlier_share(self) -> float | None:
        """KITTI's Fl; None without known flow."""
        return _ratio(self.outliers, self.known)

    @property
    def epe_px(self) -> float | None:
        """Mean endpoint error; None without known flow."""
        return _ratio(self.error_px, self.known)

    @property
    def epe_consistent_px(self) -> float | None:
        """Mean endpoint error of the pixels that pass the cycle test."""
        return _ratio(self.error_consistent_px, self.known_consistent)

    @property
    def epe_inconsistent_px(self) -> float | None:
        """Mean endpoint error of the pixels that fail it."""
        left = self.known - self.known_consistent
        return _ratio(self.error_px - self.error_consistent_px, left)

    @property
    def epe_moving_px(self) -> float | None:
        """Mean endpoint error of the moving pixels: before a still camera most of the rest is 0."""
        return _ratio(self.error_moving_px, self.moving)

    def of_zeros(self) -> FlowScore:
        """Return what a flow of zeros would score there; it passes the cycle test everywhere."""
        return replace(
            self,
            consistent=self.pixels,
            known_consistent=self.known,
            outliers=self.long,
            error_px=self.length_px,
            error_consistent_px=self.length_px,
            error_moving_px=self.length_moving_px,
        )


def flow_score(flow: Float32Array, consistent: BoolArray, truth: Float32Array | None) -> FlowScore:
    """Score one flow.

    Args:
        flow: (H, W, 2) px.
        consistent: (H, W): which pixels pass the cycle test.
        truth: (H, W, 2) px, NaN where it is not known; None when it is known nowhere.
    """
    passed = int(consistent.sum())
    if truth is None:
        return FlowScore(consistent.size, passed)
    known = np.isfinite(truth).all(axis=2)
    wanted = truth[known].astype(np.float64)
    error = np.linalg.norm(flow[known].astype(np.float64) - wanted, axis=1)
    length = np.linalg.norm(wanted, axis=1)
    wrong = (error > OUTLIER_PX) & (error > OUTLIER_SHARE * length)
    checked, moving = consistent[known], length >= MOVING_PX
    return FlowScore(
        pixels=consistent.size,
        consistent=passed,
        known=int(known.sum()),
        known_consistent=int(checked.sum()),
        outliers=int(wrong.sum()),
        error_px=float(error.sum()),
        error_consistent_px=float(error[checked].sum()),
        moving=int(moving.sum()),
        error_moving_px=float(error[moving].sum()),
        length_px=float(length.sum()),
        length_moving_px=float(length[moving].sum()),
        long=int((length > OUTLIER_PX).sum()),
    )


def total_score(scores: Iterable[FlowScore]) -> FlowScore:
    """Return the score of several flows together."""
    found = list(scores)
    names = FlowScore.__dataclass_fields__
    return FlowScore(**{name: sum(getattr(score, name) for score in found) for name in names})


def _ratio(part: float, whole: int) -> float | None:
    return float(part) / whole if whole else None
