"""The image's view of 3D boxes: corners, 2D boxes and how much of them the image cuts off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.geometry.transforms import level_project
from tcrdata.types import FloatArray

# The four sides of the bottom and of the top, and the four uprights.
_EDGES = np.array(
    [(a, (a + 1) % 4) for a in range(4)]
    + [(4 + a, 4 + (a + 1) % 4) for a in range(4)]
    + [(a, 4 + a) for a in range(4)]
)
# What lies nearer to the camera's plane than this is cut off, in metres.
_NEAR_M = 0.05


@dataclass(frozen=True)
class ProjectedBoxes:
    """N boxes as the image sees them; NaN where a box lies behind the camera.

    Attributes:
        left_px: (N,) clipped to the image; the same holds for the three below.
        top_px: (N,).
        right_px: (N,).
        bottom_px: (N,).
        center_u_px: (N,) column of the 3D centre, not clipped.
        center_v_px: (N,) row of the 3D centre, not clipped.
        truncated_share: (N,) share of the unclipped 2D box outside the image.
    """

    left_px: FloatArray
    top_px: FloatArray
    right_px: FloatArray
    bottom_px: FloatArray
    center_u_px: FloatArray
    center_v_px: FloatArray
    truncated_share: FloatArray

    def columns(self) -> dict[str, FloatArray]:
        """Return the arrays by the names that `proposals` has for them."""
        return dict(self.__dict__)


def box_corners(boxes: NDArray[np.floating]) -> FloatArray:
    """Return the (N, 8, 3) corners of (N, 7) boxes: four at the bottom (larger y), four on top."""
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    bev = box_corners_bev(boxes)
    corners = np.empty((len(boxes), 8, 3))
    corners[:, :4, [0, 2]] = corners[:, 4:, [0, 2]] = bev
    corners[:, :4, 1] = (boxes[:, 1] + boxes[:, 5] / 2)[:, None]
    corners[:, 4:, 1] = (boxes[:, 1] - boxes[:, 5] / 2)[:, None]
    return corners


def project_boxes(
    boxes: NDArray[np.floating],
    level_projection: FloatArray,
    width_px: int,
    height_px: int,
) -> ProjectedBoxes:
    """Project (N, 7) level boxes; a box that crosses the camera's plane is cut there first.

    Args:
        boxes: level frame.
        level_projection: (3, 4) level frame (m) to homogeneous pixels.
        width_px: of the image.
        height_px: of the image.
    """
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    low, high = _bounds(boxes, level_projection)
    size = np.array([width_px, height_px], dtype=np.float64)
    clipped_low, clipped_high = np.clip(low, 0, size), np.clip(high, 0, size)
    whole = np.prod(high - low, axis=1)
    shown = np.prod(clipped_high - clipped_low, axis=1)
    center, _ = level_project(level_projection, boxes[:, :3])
    with np.errstate(invalid="ignore", divide="ignore"):
        truncated = np.where(whole > 0, 1 - shown / whole, np.nan)
    return ProjectedBoxes(
        left_px=clipped_low[:, 0],
        top_px=clipped_low[:, 1],
        right_px=clipped_high[:, 0],
        bottom_px=clipped_high[:, 1],
        center_u_px=center[:, 0],
        center_v_px=center[:, 1],
        truncated_share=truncated,
    )


def _bounds(boxes: FloatArray, level_projection: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the (N, 2) lowest and highest pixels of the part in front; NaN when there is none."""
    corners = box_corners(boxes)
    homogeneous = corners @ level_projection[:, :3].T + level_projection[:, 3]
    a, b = homogeneous[:, _EDGES[:, 0]], homogeneous[:, _EDGES[:, 1]]
    step = b[..., 2] - a[..., 2]
    share = np.clip((_NEAR_M - a[..., 2]) / np.where(step == 0, 1.0, step), 0, 1)
    cut = a + share[..., None] * (b - a)
    crosses = (a[..., 2] < _NEAR_M) != (b[..., 2] < _NEAR_M)
    cut[~crosses] = np.nan
    points = np.concatenate([homogeneous, cut], axis=1)
    with np.errstate(invalid="ignore"):
        points[points[..., 2] < _NEAR_M * (1 - 1e-9)] = np.nan
        pixels = points[..., :2] / points[..., 2:]
    empty = np.isnan(pixels).all(axis=(1, 2))
    low = np.nanmin(np.where(empty[:, None, None], 0.0, pixels), axis=1, initial=np.inf)
    high = np.nanmax(np.where(empty[:, None, None], 0.0, pixels), axis=1, initial=-np.inf)
    low[empty], high[empty] = np.nan, np.nan
    return low, high
