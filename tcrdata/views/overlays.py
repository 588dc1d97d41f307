"""Boxes drawn into the camera's image, as wire frames with a tinted front."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import FloatArray, ImageArray
from tcrdata.views.palette import BACKGROUND, BoxStyle, box_style, in_drawing_order

_RING = ((0, 1), (1, 2), (2, 3), (3, 0))
_EDGES = np.array(
    [pair for a, b in _RING for pair in ((a, b), (a + 4, b + 4))] + [(c, c + 4) for c in range(4)]
)
_FRONT = [0, 1, 5, 4]
_NEAREST_M = 0.05


def corners_3d(boxes: NDArray[np.floating]) -> FloatArray:
    """Return the (N, 8, 3) corners of (N, 7) boxes: four below, four above, the front two first."""
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    flat = box_corners_bev(boxes)
    # Two corners of positive length sign stand at 0 and 1: the front.
    levels = (boxes[:, 1:2] + boxes[:, 5:6] / 2, boxes[:, 1:2] - boxes[:, 5:6] / 2)
    layers = [
        np.stack([flat[:, :, 0], np.broadcast_to(y, flat.shape[:2]), flat[:, :, 1]], axis=2)
        for y in levels
    ]
    return np.concatenate(layers, axis=1)


def wire_frame(corners: FloatArray, projection: FloatArray) -> FloatArray:
    """Return the (E, 2, 2) pixels of a box's edges, cut where they pass behind the camera.

    Args:
        corners: (8, 3), level frame.
        projection: (3, 4), level frame to homogeneous pixels.
    """
    pixels = corners @ projection[:, :3].T + projection[:, 3]
    ends = pixels[_EDGES]
    depth = ends[:, :, 2]
    ends, depth = ends[(depth > _NEAREST_M).any(axis=1)], depth[(depth > _NEAREST_M).any(axis=1)]
    span = depth[:, 1] - depth[:, 0]
    share = (_NEAREST_M - depth[:, 0]) / np.where(span == 0, 1.0, span)
    cut = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
    ends = np.where((depth > _NEAREST_M)[:, :, None], ends, cut[:, None])
    return np.asarray(ends[:, :, :2] / ends[:, :, 2:])


def draw_image(axes: Axes, image: ImageArray) -> None:
    """Show an (H, W, 3) RGB image without ticks; drawing is clipped to it."""
    height, width = image.shape[:2]
    axes.imshow(image, interpolation="bicubic", extent=(0, width, height, 0))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_axis_off()


def draw_boxes(
    axes: Axes, boxes: Mapping[str, NDArray[np.floating]], projection: FloatArray
) -> None:
    """Draw kinds of (N, 7) boxes over the image."""
    for kind in in_drawing_order(list(boxes)):
        style = box_style(kind)
        for corners in corners_3d(boxes[kind]):
            _draw_box(axes, corners, projection, style)


def _draw_box(axes: Axes, corners: FloatArray, projection: FloatArray, style: BoxStyle) -> None:
    edges = wire_frame(corners, projection)
    if not len(edges):
        return
    depth = corners @ projection[2, :3] + projection[2, 3]
    if style.fill_alpha and (depth > _NEAREST_M).all():
        front = corners[_FRONT] @ projection[:, :3].T + projection[:, 3]
        axes.add_collection(
            PolyCollection(
                [front[:, :2] / front[:, 2:]],
                facecolors=style.color,
                alpha=style.fill_alpha,
                linewidths=0,
                zorder=2 + style.order,
            )
        )
    lines = LineCollection(
        list(edges),
        colors=style.color,
        linewidths=style.width_pt,
        alpha=style.alpha,
        capstyle="butt" if style.dashes else "round",
        linestyles=[(0, style.dashes)] if style.dashes else "solid",
        zorder=2 + style.order,
    )
    if style.halo:
        halo = Stroke(linewidth=style.width_pt + 0.9, foreground=BACKGROUND, alpha=0.45)
        lines.set_path_effects([halo, Normal()])
    axes.add_collection(lines)
