"""One frame as a picture: the image with boxes beside the bird's-eye view; sheets of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tcrdata.types import FloatArray, ImageArray
from tcrdata.views.birds_eye import Extent, Votes, draw_birds_eye, fitting_extent
from tcrdata.views.canvas import drawing, png_bytes, png_image, rendered
from tcrdata.views.overlays import draw_boxes, draw_image
from tcrdata.views.palette import (
    BACKGROUND,
    NO_VOTE,
    SEEN_AGAIN,
    SEEN_THROUGH,
    TEXT,
    box_style,
    in_legend_order,
)

_WIDTH_IN = 8.3
_GAP_IN = 0.08
_TITLE_IN = 0.26
_LEGEND_IN = 0.26
_WIDE = 2.0
_LEVEL_SLOPE = 0.05
_Boxes = Mapping[str, NDArray[np.floating]]


def frame_picture(
    image: ImageArray | None,
    points: NDArray[np.floating],
    votes: Votes | None,
    boxes: _Boxes,
    projection: FloatArray | None,
    metric_scale: float = 1.0,
    title: str = "",
    extent: Extent | None = None,
) -> bytes:
    """Return a PNG, 1660 pixels wide: a wide image above the bird's-eye view, others beside it.

    Args:
        image: (H, W, 3) RGB; None for the bird's-eye view alone.
        points: (N, 3), level frame.
        votes: free-space votes of the points; None leaves them grey.
        boxes: kind (`labels`, `truth`, `rejected`, `ignored`) to (N, 7), level frame.
        projection: (3, 4), level frame to homogeneous pixels; None draws no box in the image.
        metric_scale: metres here a metre of a road scene.
        title: one line.
        extent: what the bird's-eye view shows; None chooses.
    """
    extent = extent or fitting_extent(points, boxes, metric_scale)
    aspect = image.shape[1] / image.shape[0] if image is not None else None
    places, height_in, forward_up = _layout(aspect, extent)
    with drawing(_WIDTH_IN, height_in) as figure:
        view = None
        if image is not None:
            image_axes = figure.add_axes(places[0])
            draw_image(image_axes, image)
            if projection is not None:
                draw_boxes(image_axes, boxes, projection)
                view = _field_of_view(projection, image.shape[1])
        ground_axes = figure.add_axes(places[1])
        draw_birds_eye(
            ground_axes, points, votes, boxes, extent, forward_up=forward_up, field_of_view=view
        )
        _title(figure, title, height_in)
        _legend(figure, boxes, votes is not None, height_in)
        return png_bytes(rendered(figure))


def contact_sheet(pictures: Sequence[bytes], columns: int, gap_px: int = 12) -> bytes:
    """Put PNGs into rows of equal cells; returns a PNG.

    Args:
        pictures: at least one.
        columns: pictures a row.
        gap_px: between them.
    """
    tiles = [png_image(picture) for picture in pictures]
    height, width = (max(tile.shape[axis] for tile in tiles) for axis in (0, 1))
    rows = -(-len(tiles) // columns)
    ground = np.array([int(BACKGROUND[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.uint8)
    size = (rows * (height + gap_px) - gap_px, columns * (width + gap_px) - gap_px, 3)
    sheet = np.broadcast_to(ground, size).copy()
    for number, tile in enumerate(tiles):
        top = number // columns * (height + gap_px)
        side = number % columns * (width + gap_px)
        sheet[top : top + tile.shape[0], side : side + tile.shape[1]] = tile
    return png_bytes(sheet)


def _layout(
    aspect: float | None, extent: Extent
) -> tuple[list[tuple[float, float, float, float]], float, bool]:
    """Return places of image and ground in shares of the figure, its height, and `forward_up`."""
    inner = _WIDTH_IN - 2 * _GAP_IN
    low = _LEGEND_IN
    if aspect is None or aspect > _WIDE:
        image_in = inner / aspect if aspect else -_GAP_IN
        ground_in = inner * extent.width / extent.depth
        height = _TITLE_IN + image_in + _GAP_IN + ground_in + low
        placed = [
            (_GAP_IN, low + ground_in + _GAP_IN, inner, image_in),
            (_GAP_IN, low, inner, ground_in),
        ]
        forward_up = False
    else:
        shape = extent.width / extent.depth
        tall = (inner - _GAP_IN) / (aspect + shape)
        height = _TITLE_IN + tall + low
        placed = [
            (_GAP_IN, low, tall * aspect, tall),
            (2 * _GAP_IN + tall * aspect, low, tall * shape, tall),
        ]
        forward_up = True
    shares = [(x / _WIDTH_IN, y / height, w / _WIDTH_IN, h / height) for x, y, w, h in placed]
    return shares, height, forward_up


def _field_of_view(projection: FloatArray, width_px: int) -> tuple[float, float] | None:
    """Slopes x / z of the image's left and right edge; None when the camera looks up or down.

    A tilted camera sees a trapezium of the ground, not a wedge.
    """
    if abs(projection[2, 1]) > _LEVEL_SLOPE * abs(projection[2, 2]):
        return None
    slopes = [
        (u * projection[2, 2] - projection[0, 2]) / (projection[0, 0] - u * projection[2, 0])
        for u in (0, width_px)
    ]
    return float(slopes[0]), float(slopes[1])


def _title(figure: Figure, title: str, height_in: float) -> None:
    figure.text(
        _GAP_IN / _WIDTH_IN,
        1 - _TITLE_IN / 2 / height_in,
        title,
        ha="left",
        va="center",
        fontsize=8,
        color=TEXT,
    )


def _legend(figure: Figure, boxes: _Boxes, with_votes: bool, height_in: float) -> None:
    handles = []
    for kind in in_legend_order(list(boxes)):
        style = box_style(kind)
        line = Line2D([], [], color=style.color, lw=1.4, label=f"{kind} ({len(boxes[kind])})")
        if style.dashes:
            line.set_linestyle((0, style.dashes))
        handles.append(line)
    names = {SEEN_THROUGH: "seen through: it moved", SEEN_AGAIN: "seen again: static"}
    names[NO_VOTE] = "no vote" if with_votes else "points"
    for color, name in names.items() if with_votes else [(NO_VOTE, "points")]:
        dot = Line2D([], [], marker="o", ms=3.5, lw=0, mew=0, color=color, label=name)
        handles.append(dot)
    figure.legend(
        handles=handles,
        loc="center",
        bbox_to_anchor=(0.5, _LEGEND_IN / 2 / height_in),
        ncols=len(handles),
        frameon=False,
        fontsize=6.5,
        labelcolor=TEXT,
        handlelength=2.2,
        columnspacing=1.8,
    )
