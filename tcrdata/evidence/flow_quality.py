"""What can be said of a flow without truth: cycle consistency, and whether the images agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tcrdata.evidence.flow_cycle import measure
from tcrdata.types import Float32Array, ImageArray


class FlowQuality(NamedTuple):
    """Numbers of one flow.

    Attributes:
        pixels: of the image.
        consistent_share: share of pixels that pass the paper's cycle test.
        inside_share: share of pixels whose flow ends inside the image.
        photometric_error: mean |I1(p) - I2(p + w)| of colours in [0, 1] over these; None without.
        magnitude_median_px: median of |w|.
    """

    pixels: int
    consistent_share: float
    inside_share: float
    photometric_error: float | None
    magnitude_median_px: float


def flow_quality(
    first: ImageArray, second: ImageArray, flow: Float32Array, back: Float32Array
) -> FlowQuality:
    """Measure a flow.

    Args:
        first: (H, W, 3) RGB.
        second: the same size.
        flow: (H, W, 2) px, from first to second.
        back: (H, W, 2) px, from second to first.
    """
    import cv2

    height, width = flow.shape[:2]
    cycle = measure(flow, back)
    inside = np.isfinite(cycle.error_px)
    columns, rows = np.meshgrid(
        np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    )
    ends = flow + np.stack([columns, rows], axis=2)
    warped = cv2.remap(second.astype(np.float32), ends, None, cv2.INTER_LINEAR)
    error = np.abs(first.astype(np.float32) - warped)[inside] / 255
    return FlowQuality(
        pixels=inside.size,
        consistent_share=float(cycle.paper.mean()),
        inside_share=float(inside.mean()),
        photometric_error=float(error.mean(dtype=np.float64)) if len(error) else None,
        magnitude_median_px=float(np.median(np.hypot(flow[..., 0], flow[..., 1]))),
    )
