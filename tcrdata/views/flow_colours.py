"""Optical flow as colours: direction is the hue, length the saturation.

The wheel of Baker et al., "A database and evaluation methodology for optical flow" (IJCV 2011).
"""

from __future__ import annotations

import numpy as np

from tcrdata.types import BoolArray, Float32Array, FloatArray, ImageArray

# Steps from red to yellow, green, cyan, blue, magenta and back to red.
_STEPS = (15, 6, 4, 11, 13, 6)
_CORNERS = np.array(
    [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1], [1, 0, 0]], dtype=np.float64
)
_SHARE_AT_FULL = 0.99
_SMALLEST_PX = 0.5


def colour_wheel() -> FloatArray:
    """Return the (55, 3) colours of the wheel in [0, 1], from red on."""
    parts = [
        start + np.arange(steps)[:, None] / steps * (end - start)
        for steps, start, end in zip(_STEPS, _CORNERS[:-1], _CORNERS[1:], strict=True)
    ]
    return np.concatenate(parts)


def flow_picture(
    flow: Float32Array, longest_px: float | None = None, valid: BoolArray | None = None
) -> ImageArray:
    """Return flow as an (H, W, 3) RGB image; no motion is white, unknown black.

    Args:
        flow: (H, W, 2) pixels.
        longest_px: the length of full colour; None for the flow's own 99th percentile.
        valid: (H, W) where the flow is known; None where it is finite.
    """
    known: BoolArray = np.isfinite(flow[:, :, 0]) & np.isfinite(flow[:, :, 1])
    if valid is not None:
        known = known & valid
    u, v = (np.where(known, flow[:, :, i], 0).astype(np.float64) for i in (0, 1))
    length = np.hypot(u, v)
    if longest_px is None:
        longest_px = float(np.quantile(length[known], _SHARE_AT_FULL)) if known.any() else 1.0
    length /= max(longest_px, _SMALLEST_PX)
    wheel = colour_wheel()
    place = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (len(wheel) - 1)
    low = np.floor(place).astype(np.int64)
    share = (place - low)[:, :, None]
    colour = (1 - share) * wheel[low] + share * wheel[(low + 1) % len(wheel)]
    # Inside the wheel towards white; beyond it darker, as the original does.
    saturated = np.minimum(length, 1.0)[:, :, None]
    colour = np.where(length[:, :, None] <= 1, 1 - saturated * (1 - colour), colour * 0.75)
    return np.asarray(np.where(known[:, :, None], colour * 255, 0), dtype=np.uint8)
