"""Cycle tests of optical flow: there and back again should end where it began.

`w` is the flow from frame t to t+1, `w'` the flow from t+1 to t, both (H, W, 2) float32 in pixels
(columns, rows); `w''(p) = w'(p + w(p))`, sampled bilinearly. A pixel that leaves the image has no
`w''` and passes no test.

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), eq. 4 and 5, and its released code.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array

PAPER_BIT = 1
RELEASE_BIT = 2


class Cycle(NamedTuple):
    """What a flow and the flow back say of each pixel.

    Attributes:
        error_px: (H, W) float32, `|w + w''|`; NaN where `p + w` lies outside the image.
        paper: (H, W) bool, `|w + w''|^2 < 0.05 (|w|^2 + |w''|^2) + 0.5`.
        release: (H, W) bool, `|w + w''| < 0.05 |[w, w'']| + 0.5 px`, not yet one to one.
    """

    error_px: Float32Array
    paper: BoolArray
    release: BoolArray


@compiled
def _measure(
    flow: Float32Array, back: Float32Array, share: float, slack: float
) -> tuple[Float32Array, BoolArray, BoolArray]:
    height, width = flow.shape[0], flow.shape[1]
    error = np.full((height, width), np.nan, np.float32)
    paper = np.zeros((height, width), np.bool_)
    release = np.zeros((height, width), np.bool_)
    for i in range(height):
        for j in range(width):
            u, v = float(flow[i, j, 0]), float(flow[i, j, 1])
            x, y = j + u, i + v
            if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
                continue
            j0, i0 = min(int(x), width - 2), min(int(y), height - 2)
            fx, fy = x - j0, y - i0
            top = (1 - fx) * back[i0, j0] + fx * back[i0, j0 + 1]
            bottom = (1 - fx) * back[i0 + 1, j0] + fx * back[i0 + 1, j0 + 1]
            u2 = (1 - fy) * top[0] + fy * bottom[0]
            v2 = (1 - fy) * top[1] + fy * bottom[1]
            squared = (u + u2) ** 2 + (v + v2) ** 2
            size = u * u + v * v + u2 * u2 + v2 * v2
            error[i, j] = math.sqrt(squared)
            paper[i, j] = squared < share * size + slack
            release[i, j] = math.sqrt(squared) < share * math.sqrt(size) + slack
    return error, paper, release


@compiled
def reached(flow: Float32Array) -> BoolArray:
    """Return (H, W): pixels of the other frame that are a corner of where some flow ends."""
    height, width = flow.shape[0], flow.shape[1]
    mask = np.zeros((height, width), np.bool_)
    for i in range(height):
        for j in range(width):
            x, y = j + flow[i, j, 0], i + flow[i, j, 1]
            if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
                continue
            j0, i0 = int(x), int(y)
            j1, i1 = min(j0 + 1, width - 1), min(i0 + 1, height - 1)
            mask[i0, j0] = mask[i0, j1] = mask[i1, j0] = mask[i1, j1] = True
    return mask


@compiled
def _and_at_end(flow: Float32Array, mask: BoolArray, other: BoolArray) -> BoolArray:
    """Return `mask(p) and other(p + w(p))`, the end rounded to a pixel."""
    height, width = mask.shape
    both = np.zeros((height, width), np.bool_)
    for i in range(height):
        for j in range(width):
            if mask[i, j]:
                column = math.floor(j + flow[i, j, 0] + 0.5)
                row = math.floor(i + flow[i, j, 1] + 0.5)
                if 0 <= column < width and 0 <= row < height:
                    both[i, j] = other[row, column]
    return both


def measure(
    flow: Float32Array, back: Float32Array, share: float = 0.05, slack_px: float = 0.5
) -> Cycle:
    """Follow the flow and the flow back, and test each pixel of the first frame (eq. 5).

    Args:
        flow: (H, W, 2) px, H and W at least 2.
        back: (H, W, 2) px, from the other frame to this one.
        share: alpha 1, of the length (release) or the squared lengths (paper).
        slack_px: alpha 2, px (release) or px^2 (paper).
    """
    return Cycle(*_measure(flow, back, share, slack_px))


def one_to_one(
    flow: Float32Array, back: Float32Array, here: Cycle, there: Cycle
) -> tuple[BoolArray, BoolArray]:
    """Return the release's test of both frames, each (H, W).

    A pixel passes when its own test holds, some flow back reaches it, and the same is true of the
    pixel in the other frame at which its flow ends.
    """
    own_here = here.release & reached(back)
    own_there = there.release & reached(flow)
    return _and_at_end(flow, own_here, own_there), _and_at_end(back, own_there, own_here)
