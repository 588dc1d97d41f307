"""One proposal as a picture: in the image, from above, and how far each rule was from its bound."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tcrdata.types import FloatArray, ImageArray
from tcrdata.views.birds_eye import Extent, Votes, draw_birds_eye, vote_classes
from tcrdata.views.canvas import drawing, png_bytes, rendered
from tcrdata.views.overlays import corners_3d, draw_boxes, draw_image
from tcrdata.views.palette import (
    BACKGROUND,
    GRID,
    MUTED,
    NO_VOTE,
    PANEL,
    SEEN_AGAIN,
    SEEN_THROUGH,
    TEXT,
    box_style,
)

_WIDTH_IN = 8.3
_GAP_IN = 0.1
_TITLE_IN = 0.5
_SCENE_IN = 3.1
_IMAGE_IN = 4.8
_ROW_IN = 0.2
_BARS_IN = (1.25, 2.2)  # left end and width of the bars; names before, sentences behind
_FOOT_IN = 0.3
_AROUND_M = 3.0
_ZOOM = 2.2  # the image shows so many times the box
_LEAST_PX = 160
_FULL_MARGIN = 1.0
_LEAST_BAR = 0.02
_SENTENCE = 92  # characters
_COLORS = {"passed": box_style("labels").color, "failed": box_style("rejected").color}


_Rectangle = tuple[float, float, float, float]


class RuleBar(NamedTuple):
    """A rule's row of the picture.

    Attributes:
        rule: its name.
        verdict: passed, failed or abstained.
        margin: in bounds, positive when it passes; None without numbers.
        says: the verdict as a sentence.
        marked: it decides: drawn brighter, with a mark.
    """

    rule: str
    verdict: str
    margin: float | None
    says: str
    marked: bool


class Surroundings(NamedTuple):
    """What was measured in the frame.

    Attributes:
        image: (H, W, 3) RGB; None without one.
        projection: (3, 4), level frame to homogeneous pixels; None without a camera.
        points: (N, 3), level frame.
        votes: free-space votes of the points; None leaves them grey.
        metric_scale: metres here a metre of a road scene.
    """

    image: ImageArray | None
    projection: FloatArray | None
    points: NDArray[np.floating]
    votes: Votes | None
    metric_scale: float


def why_picture(
    scene: Surroundings,
    box: NDArray[np.floating],
    own_points: Sequence[int],
    others: Mapping[str, NDArray[np.floating]],
    bars: Sequence[RuleBar],
    title: Sequence[str],
) -> bytes:
    """Return a PNG, 1660 pixels wide.

    Args:
        scene: the frame.
        box: (7,), level frame: drawn in white.
        own_points: indices of its points.
        others: kind to (N, 7) of other boxes of the frame.
        bars: a row a rule, in order.
        title: two lines.
    """
    boxes = {
        name: np.asarray(rows, dtype=np.float64).reshape(-1, 7) for name, rows in others.items()
    }
    own = np.asarray(box, dtype=np.float64).reshape(1, 7)
    boxes["asked"] = own
    window = _window(scene, own)
    height = _TITLE_IN + _SCENE_IN + _ROW_IN * (len(bars) + 1) + _FOOT_IN + 2 * _GAP_IN
    with drawing(_WIDTH_IN, height) as figure:
        place = _Places(height)
        left = _GAP_IN
        if window is not None and scene.image is not None and scene.projection is not None:
            axes = figure.add_axes(place.of(left, _TITLE_IN, _IMAGE_IN, _SCENE_IN))
            _image(axes, scene, window, boxes, own_points)
            left += _IMAGE_IN + _GAP_IN
        width = _WIDTH_IN - _GAP_IN - left
        axes = figure.add_axes(place.of(left, _TITLE_IN, width, _SCENE_IN))
        extent = _around(own[0], width / _SCENE_IN, scene.metric_scale)
        draw_birds_eye(axes, scene.points, scene.votes, boxes, extent, forward_up=True)
        _mark_points(axes, scene.points[list(own_points)][:, [0, 2]])
        top = _TITLE_IN + _SCENE_IN + 2 * _GAP_IN
        rows_in = _ROW_IN * (len(bars) + 1)
        _bars(figure.add_axes(place.of(_BARS_IN[0], top, _BARS_IN[1], rows_in)), bars)
        _title(figure, title, height)
        _foot(figure, height, with_votes=scene.votes is not None)
        return png_bytes(rendered(figure))


class _Places(NamedTuple):
    """Inches from the upper left corner as shares of the figure."""

    height_in: float

    def of(self, left: float, top: float, width: float, height: float) -> _Rectangle:
        whole = self.height_in
        bottom = whole - top - height
        return left / _WIDTH_IN, bottom / whole, width / _WIDTH_IN, height / whole


def _around(box: FloatArray, aspect: float, scale: float) -> Extent:
    """The ground around a box, in the panel's aspect (width / height)."""
    half = 0.5 * float(np.hypot(box[3], box[4])) + _AROUND_M * scale
    return Extent(
        float(box[0]) - half * aspect,
        float(box[0]) + half * aspect,
        float(box[2]) - half,
        float(box[2]) + half,
    )


def _window(scene: Surroundings, box: FloatArray) -> tuple[float, float, float, float] | None:
    """Left, right, top and bottom pixel of the part of the image that is shown.

    None where the box does not lie before the camera and in the image.
    """
    if scene.image is None or scene.projection is None:
        return None
    corners = corners_3d(box)[0]
    pixels = corners @ scene.projection[:, :3].T + scene.projection[:, 3]
    if (pixels[:, 2] <= 0).any():
        return None
    uv = pixels[:, :2] / pixels[:, 2:]
    low, high = uv.min(axis=0), uv.max(axis=0)
    rows, columns = scene.image.shape[:2]
    if high[0] < 0 or high[1] < 0 or low[0] > columns or low[1] > rows:
        return None
    aspect = _IMAGE_IN / _SCENE_IN
    center = np.clip((low + high) / 2, 0, (columns, rows))
    width = max(_ZOOM * (high[0] - low[0]), _ZOOM * (high[1] - low[1]) * aspect, _LEAST_PX)
    width = min(width, columns, rows * aspect)
    half = np.array([width, width / aspect]) / 2
    center = np.clip(center, half, np.array([columns, rows]) - half)
    return (
        float(center[0] - half[0]),
        float(center[0] + half[0]),
        float(center[1] - half[1]),
        float(center[1] + half[1]),
    )


def _image(
    axes: Axes,
    scene: Surroundings,
    window: tuple[float, float, float, float],
    boxes: Mapping[str, FloatArray],
    own_points: Sequence[int],
) -> None:
    """The part of the image around the box, with boxes and the proposal's points by their votes."""
    if scene.image is None or scene.projection is None:
        return
    draw_image(axes, scene.image)
    draw_boxes(axes, boxes, scene.projection)
    points = scene.points[list(own_points)]
    classes = vote_classes(scene.votes, len(scene.points))[list(own_points)]
    pixels = points @ scene.projection[:, :3].T + scene.projection[:, 3]
    seen = pixels[:, 2] > 0
    uv = pixels[seen, :2] / pixels[seen, 2:]
    for number, color in enumerate((NO_VOTE, SEEN_AGAIN, SEEN_THROUGH)):
        chosen = uv[classes[seen] == number]
        axes.plot(
            chosen[:, 0], chosen[:, 1], "o", ms=1.7, mew=0.25, mec=BACKGROUND, color=color, zorder=4
        )
    axes.set_xlim(window[0], window[1])
    axes.set_ylim(window[3], window[2])


def _mark_points(axes: Axes, xz: NDArray[np.floating]) -> None:
    """Rings around the proposal's own points, seen from above."""
    axes.plot(xz[:, 0], xz[:, 1], "o", ms=3.0, mew=0.3, mec=TEXT, mfc="none", alpha=0.8, zorder=4)


def _bars(axes: Axes, bars: Sequence[RuleBar]) -> None:
    """A row a rule: its name, a bar from the bound to the value, and the sentence."""
    axes.set_facecolor(PANEL)
    axes.set_xlim(-_FULL_MARGIN, _FULL_MARGIN)
    axes.set_ylim(len(bars) - 0.5, -1.5)
    axes.set_yticks([])
    axes.set_xticks([])
    axes.axvline(0, color=MUTED, linewidth=0.8, zorder=3)
    for half in (-0.5, 0.5):
        axes.axvline(half * _FULL_MARGIN, color=GRID, linewidth=0.5, zorder=0)
    for x, text in ((-0.5, "fails"), (0.5, "passes")):
        axes.text(x, -1, text, ha="center", va="center", fontsize=6, color=MUTED)
    for row, bar in enumerate(bars):
        _bar(axes, row, bar)


def _bar(axes: Axes, row: int, bar: RuleBar) -> None:
    color = _COLORS.get(bar.verdict, MUTED)
    strength = "bold" if bar.marked else "normal"
    mark = "\N{BLACK RIGHT-POINTING SMALL TRIANGLE} " if bar.marked else ""
    named: dict[str, Any] = {
        "fontsize": 6.5,
        "va": "center",
        "clip_on": False,
        "fontweight": strength,
    }
    axes.text(-1.03, row, mark + bar.rule, ha="right", color=TEXT, **named)
    text = textwrap.shorten(bar.says, _SENTENCE, placeholder=" \N{HORIZONTAL ELLIPSIS}")
    axes.text(1.03, row, text, ha="left", color=TEXT if bar.marked else MUTED, **named)
    if bar.verdict == "abstained":
        axes.text(0.04, row, "abstained", fontsize=5.5, va="center", color=MUTED)
        return
    sign = 1 if bar.verdict == "passed" else -1
    if bar.margin is None:
        axes.plot(sign * 0.06, row, "s", ms=4, color=color, zorder=2)
        return
    length = sign * float(np.clip(abs(bar.margin), _LEAST_BAR, _FULL_MARGIN))
    axes.barh(row, length, height=0.62, color=color, alpha=1.0 if bar.marked else 0.6, zorder=2)
    if abs(bar.margin) > _FULL_MARGIN:
        axes.plot(sign * 0.975, row, ">" if sign > 0 else "<", ms=3, color=BACKGROUND, zorder=4)


def _title(figure: Figure, lines: Sequence[str], height_in: float) -> None:
    for number, line in enumerate(lines[:2]):
        figure.text(
            _GAP_IN / _WIDTH_IN,
            1 - (0.14 + 0.2 * number) / height_in,
            line,
            va="center",
            fontsize=8.5 if number else 6.5,
            color=TEXT if number else MUTED,
        )


def _foot(figure: Figure, height_in: float, *, with_votes: bool) -> None:
    """What colours and bars mean."""
    y = 0.5 * _FOOT_IN / height_in
    bars = "bars: distance of value and bound, in bounds; a notch: more than one"
    figure.text(_GAP_IN / _WIDTH_IN, y, bars, va="center", fontsize=6, color=MUTED)
    names = ((SEEN_THROUGH, "seen through: it moved"), (SEEN_AGAIN, "seen again: static"))
    x = 0.56
    for color, name in (*names, (NO_VOTE, "no vote")) if with_votes else ((NO_VOTE, "points"),):
        figure.text(x, y, "\N{BLACK CIRCLE}", va="center", fontsize=6, color=color)
        figure.text(x + 0.012, y, name, va="center", fontsize=6, color=MUTED)
        x += 0.165
