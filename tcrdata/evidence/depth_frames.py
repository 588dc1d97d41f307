"""Depth images of a static camera, averaged over neighbouring frames where nothing moved.

A pixel's depth at a frame is averaged with those of the frames around that lie within a few
standard deviations of it, so that what moves is not blurred; a gap is filled where the nearest
depths before and after agree. A bilateral filter follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.geometry.transforms import inverse, transform_points
from tcrdata.types import Float32Array, FloatArray, Frame, PointCloud

# Median absolute deviation of a normal distribution, in standard deviations.
_MAD_SHARE = 0.6745


@dataclass(frozen=True)
class AveragingSettings:
    """How depth is averaged.

    Attributes:
        half_window_frames: frames before and after.
        sigmas: depths this many standard deviations apart are of one surface.
        filter_px: diameter of the bilateral filter.
        filter_reach_px: standard deviation of its weights in the image.
    """

    half_window_frames: int = 3
    sigmas: float = 3.0
    filter_px: int = 5
    filter_reach_px: float = 2.0


def depth_image(cloud: PointCloud, frame: Frame) -> Float32Array:
    """Return the (H, W) depth in metres along the camera's z; 0 where there is none.

    Args:
        cloud: with pixels.
        frame: gives the camera and its place.
    """
    assert frame.camera is not None
    assert cloud.pixels is not None
    depth = np.zeros((frame.camera.height_px, frame.camera.width_px), dtype=np.float32)
    points = transform_points(inverse(frame.sensor_matrix), cloud.xyz)
    depth[cloud.pixels[:, 1], cloud.pixels[:, 0]] = points[:, 2]
    return depth


def depth_noise(images: Sequence[Float32Array]) -> float:
    """Return the standard deviation (m) of one depth, from neighbouring frames' differences.

    Most pixels must show what does not move; 0 when there is one frame alone.
    """
    spreads = []
    for one, other in pairwise(images):
        known = (one > 0) & (other > 0)
        if known.any():
            spreads.append(float(np.median(np.abs(one - other)[known])))
    return float(np.median(spreads)) / (_MAD_SHARE * np.sqrt(2.0)) if spreads else 0.0


def averaged(
    window: NDArray[np.float32], center: int, noise_m: float, settings: AveragingSettings
) -> Float32Array:
    """Return the (H, W) averaged depth of one frame of a window; 0 where there is none.

    Args:
        window: (K, H, W) metres, 0 for gaps.
        center: place of the frame.
        noise_m: standard deviation of one depth.
        settings: how.
    """
    import cv2

    reach = max(settings.sigmas * noise_m, 1e-3)
    mean = _average(np.ascontiguousarray(window), center, float(reach))
    spread = reach / np.sqrt(len(window))
    smooth = cv2.bilateralFilter(mean, settings.filter_px, spread, settings.filter_reach_px)
    return np.where(mean > 0, smooth, np.float32(0.0)).astype(np.float32)


def level_points(depth: NDArray[np.floating], frame: Frame) -> FloatArray:
    """Return (H, W, 3) level points (m) of a depth image."""
    assert frame.camera is not None
    rows, columns = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
    rays = pixels @ np.linalg.inv(frame.camera.matrix[:, :3]).T
    points = transform_points(frame.sensor_matrix, rays * depth.reshape(-1, 1))
    return np.asarray(points, dtype=np.float64).reshape(*depth.shape, 3)


@compiled
def _average(window: Float32Array, center: int, reach_m: float) -> Float32Array:
    reach = np.float32(reach_m)
    frames, rows, columns = window.shape
    result = np.zeros((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            guess = window[center, row, column]
            if guess <= 0:
                guess = _between(window, center, row, column, reach_m)
            if guess <= 0:
                continue
            for _ in range(2):
                total, count = np.float32(0.0), 0
                for i in range(frames):
                    depth = window[i, row, column]
                    if depth > 0 and abs(depth - guess) < reach:
                        total += depth
                        count += 1
                if count:
                    guess = total / np.float32(count)
            result[row, column] = guess
    return result


@compiled
def _between(
    window: Float32Array, center: int, row: int, column: int, reach_m: float
) -> np.float32:
    """Return a depth for a gap: of the nearest frames before and after, where they agree."""
    before, after = np.float32(0.0), np.float32(0.0)
    for i in range(center - 1, -1, -1):
        if window[i, row, column] > 0:
            before = window[i, row, column]
            break
    for i in range(center + 1, len(window)):
        if window[i, row, column] > 0:
            after = window[i, row, column]
            break
    if before > 0 and after > 0 and abs(before - after) < np.float32(2.0 * reach_m):
        return np.float32(0.5) * (before + after)
    return np.float32(0.0)
