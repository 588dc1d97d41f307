"""The bird's-eye view: points coloured by free-space votes, boxes with headings, a range grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import FloatArray, IntArray
from tcrdata.views.palette import (
    EGO,
    GRID,
    MUTED,
    NO_VOTE,
    PANEL,
    SEEN_AGAIN,
    SEEN_THROUGH,
    TEXT,
    box_style,
    in_drawing_order,
)

_ROAD_M = (-15.0, 15.0, -5.0, 45.0)
_MARGIN_M = 6.0


class Votes(NamedTuple):
    """Free-space votes of the points.

    Attributes:
        free: (N,) sweeps that saw through the point's place.
        static: (N,) sweeps that saw the same surface there.
    """

    free: NDArray[np.generic]
    static: NDArray[np.generic]


@dataclass(frozen=True)
class Extent:
    """What part of the ground is shown, metres in the level frame."""

    x_min: float
    x_max: float
    z_min: float
    z_max: float

    @property
    def width(self) -> float:
        """Along x."""
        return self.x_max - self.x_min

    @property
    def depth(self) -> float:
        """Along z."""
        return self.z_max - self.z_min


def fitting_extent(
    points: NDArray[np.floating],
    boxes: Mapping[str, NDArray[np.floating]],
    metric_scale: float,
) -> Extent:
    """Return what to show: the road ahead of a LiDAR, or what a camera sees around the boxes.

    Args:
        points: (N, 3), level frame. Points behind the origin tell a LiDAR.
        boxes: kind to (N, 7).
        metric_scale: metres here a metre of a road scene.
    """
    if not len(points) or np.percentile(points[:, 2], 2) < 0:
        return Extent(*(bound * metric_scale for bound in _ROAD_M))
    corners = [box_corners_bev(kind).reshape(-1, 2) for kind in boxes.values() if len(kind)]
    if corners:
        around = np.concatenate(corners)
        low, high = around.min(axis=0), around.max(axis=0)
    else:
        low, high = np.percentile(points[:, [0, 2]], (10, 90), axis=0)
    margin = _MARGIN_M * metric_scale
    return Extent(low[0] - margin, high[0] + margin, max(low[1] - margin, 0), high[1] + margin)


def vote_classes(votes: Votes | None, count: int) -> IntArray:
    """Return (N,) 0 = no vote, 1 = seen again more often, 2 = seen through more often."""
    if votes is None:
        return np.zeros(count, dtype=np.int64)
    free, static = (np.asarray(v, dtype=np.int64) for v in votes)
    return np.where(free > static, 2, np.where(static > 0, 1, 0))


def draw_birds_eye(
    axes: Axes,
    points: NDArray[np.floating],
    votes: Votes | None,
    boxes: Mapping[str, NDArray[np.floating]],
    extent: Extent,
    *,
    forward_up: bool,
    field_of_view: tuple[float, float] | None = None,
) -> None:
    """Draw the scene from above.

    Args:
        axes: to draw on.
        points: (N, 3), level frame.
        votes: of the points, or None.
        boxes: kind to (N, 7).
        extent: what is shown.
        forward_up: z runs up the page and x to the right; else z runs right and x down.
        field_of_view: x / z at the left and the right edge of the image, to draw as lines.
    """
    _frame(axes, extent, forward_up)
    _range_grid(axes, extent, forward_up)
    if field_of_view is not None:
        _field_of_view(axes, extent, field_of_view, forward_up)
    _points(axes, points, vote_classes(votes, len(points)), extent, forward_up)
    for kind in in_drawing_order(list(boxes)):
        _boxes(axes, np.asarray(boxes[kind], dtype=np.float64).reshape(-1, 7), kind, forward_up)
    _ego(axes, extent, forward_up)
    _scale_bar(axes, extent, forward_up)


def _page(xz: NDArray[np.floating], forward_up: bool) -> NDArray[np.floating]:
    """(..., 2) x, z to horizontal and vertical on the page."""
    return xz if forward_up else np.stack([xz[..., 1], -xz[..., 0]], axis=-1)


def _frame(axes: Axes, extent: Extent, forward_up: bool) -> None:
    axes.set_facecolor(PANEL)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_linewidth(0.5)
    if forward_up:
        axes.set_xlim(extent.x_min, extent.x_max)
        axes.set_ylim(extent.z_min, extent.z_max)
    else:
        axes.set_xlim(extent.z_min, extent.z_max)
        axes.set_ylim(-extent.x_max, -extent.x_min)


def _range_step(reach: float) -> float:
    """Return 1, 2 or 5 times a power of ten, so that about four rings are seen."""
    power = 10.0 ** np.floor(np.log10(reach / 4))
    return float(max(step * power for step in (1, 2, 5) if step * power <= reach / 4 * 1.001))


def _range_grid(axes: Axes, extent: Extent, forward_up: bool) -> None:
    step = _range_step(extent.depth)
    reach = float(np.hypot(extent.z_max, max(abs(extent.x_min), abs(extent.x_max))))
    angles = np.linspace(-np.pi, np.pi, 361)
    ring = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    for number in range(1, int(reach / step) + 1):
        radius = number * step
        line = _page(ring * radius, forward_up)
        axes.plot(line[:, 0], line[:, 1], color=GRID, linewidth=0.6, zorder=0.5)
        _range_name(axes, extent, radius, forward_up)


def _range_name(axes: Axes, extent: Extent, radius: float, forward_up: bool) -> None:
    """Name a ring where it meets the left edge of the view, else straight ahead."""
    inset = 0.02 * min(extent.width, extent.depth)
    edge = extent.x_min + inset
    inside = radius > abs(edge) and extent.x_min < 0
    x, z = (edge, float(np.sqrt(radius**2 - edge**2))) if inside else (0.0, radius)
    if not extent.z_min + 3 * inset < z < extent.z_max - 3 * inset:
        return
    place = _page(np.array([x, z]), forward_up)
    axes.text(
        float(place[0]),
        float(place[1]),
        f"{radius:g} m",
        color=MUTED,
        fontsize=5.5,
        ha="left" if forward_up else "center",
        va="bottom" if forward_up else "top",
        zorder=6,
        clip_on=True,
        path_effects=[Stroke(linewidth=1.5, foreground=PANEL), Normal()],
    )


def _scale_bar(axes: Axes, extent: Extent, forward_up: bool) -> None:
    """A bar of known length in the corner that is near and to the right."""
    length = _range_step(extent.width)
    right, bottom = (extent.x_max, extent.z_min) if forward_up else (extent.z_max, -extent.x_max)
    inset = 0.03 * min(extent.width, extent.depth)
    ends, height = np.array([right - inset - length, right - inset]), bottom + inset
    rim = [Stroke(linewidth=3.0, foreground=PANEL), Normal()]
    axes.plot(ends, [height] * 2, color=TEXT, linewidth=1.2, zorder=6, path_effects=rim)
    axes.text(
        float(ends.mean()),
        height + inset / 3,
        f"{length:g} m",
        color=TEXT,
        fontsize=5.5,
        ha="center",
        va="bottom",
        zorder=6,
        path_effects=[Stroke(linewidth=1.5, foreground=PANEL), Normal()],
    )


def _field_of_view(
    axes: Axes, extent: Extent, slopes: tuple[float, float], forward_up: bool
) -> None:
    reach = extent.z_max * 2
    for slope in slopes:
        line = _page(np.array([[0.0, 0.0], [slope * reach, reach]]), forward_up)
        axes.plot(line[:, 0], line[:, 1], color=MUTED, linewidth=0.5, alpha=0.6, zorder=0.6)


def _points(
    axes: Axes,
    points: NDArray[np.floating],
    classes: IntArray,
    extent: Extent,
    forward_up: bool,
) -> None:
    x, z = points[:, 0], points[:, 2]
    shown = (x > extent.x_min) & (x < extent.x_max) & (z > extent.z_min) & (z < extent.z_max)
    size = float(np.clip(150 / np.sqrt(max(int(shown.sum()), 1)), 0.55, 1.5))
    for number, (color, alpha, scale) in enumerate(
        ((NO_VOTE, 0.7, 0.85), (SEEN_AGAIN, 0.85, 1.0), (SEEN_THROUGH, 1.0, 1.5))
    ):
        chosen = _page(points[shown & (classes == number)][:, [0, 2]], forward_up)
        axes.plot(
            chosen[:, 0],
            chosen[:, 1],
            linestyle="none",
            marker="o",
            markersize=size * scale,
            markeredgewidth=0,
            color=color,
            alpha=alpha,
            zorder=1 + number / 10,
        )


def _boxes(axes: Axes, boxes: FloatArray, kind: str, forward_up: bool) -> None:
    """Outlines, with a line from the centre through the front."""
    if not len(boxes):
        return
    style = box_style(kind)
    corners = _page(box_corners_bev(boxes), forward_up)
    heading = np.stack([np.cos(boxes[:, 6]), -np.sin(boxes[:, 6])], axis=1)
    centre = boxes[:, [0, 2]]
    tip = centre + heading * (boxes[:, 3:4] / 2 + 0.35 * boxes[:, 4:5])
    ticks = np.stack([_page(centre, forward_up), _page(tip, forward_up)], axis=1)
    dashes = [(0.0, style.dashes)] if style.dashes else "solid"
    if style.fill_alpha:
        axes.add_collection(
            PolyCollection(
                list(corners),
                facecolors=style.color,
                alpha=style.fill_alpha,
                linewidths=0,
                zorder=2 + style.order,
            )
        )
    outlines = np.concatenate([corners, corners[:, :1]], axis=1)
    for lines, width in ((outlines, style.width_pt), (ticks, style.width_pt * 0.8)):
        axes.add_collection(
            LineCollection(
                list(lines),
                colors=style.color,
                linewidths=width,
                alpha=style.alpha,
                linestyles=dashes if lines is outlines else "solid",
                zorder=2 + style.order,
            )
        )


def _ego(axes: Axes, extent: Extent, forward_up: bool) -> None:
    """A small triangle at the origin, pointing ahead, when the origin is shown."""
    if extent.z_min > 0:
        return
    size = 0.022 * extent.depth
    shape = np.array([[0.0, size], [-0.6 * size, -0.7 * size], [0.6 * size, -0.7 * size]])
    page = _page(shape, forward_up)
    axes.fill(page[:, 0], page[:, 1], color=EGO, linewidth=0, zorder=7)
