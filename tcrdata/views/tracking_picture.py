"""Pictures of tracking: overlap over time, and each object's timeline with its occlusions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from tcrdata.types import BoolArray, FloatArray, ImageArray, IntArray
from tcrdata.views.canvas import drawing, rendered
from tcrdata.views.palette import GRID, MUTED, PANEL, TEXT, TRACKS

_FOUND = {
    "given": "#e4e9f1",
    "nearest": TRACKS[0],
    "correlation": TRACKS[4],
    "library": TRACKS[1],
    "container": TRACKS[3],
    "interpolated": TRACKS[5],
}
_HIDDEN = "#8a4f7d"


@dataclass(frozen=True)
class Line:
    """Mean overlap with time.

    Attributes:
        name: in the legend.
        iou: (N,) one a frame from the start; NaN where nothing is scored.
    """

    name: str
    iou: FloatArray


@dataclass(frozen=True)
class Lane:
    """One object's time.

    Attributes:
        name: beside the lane.
        frames: (N,) in which the object is there.
        hidden: (N,) out of sight.
        tracked: (K,) frames in which its tracklet has a box.
        found: how each of these was found.
        iou: (K,) overlap with the object.
    """

    name: str
    frames: IntArray
    hidden: BoolArray
    tracked: IntArray
    found: tuple[str, ...]
    iou: FloatArray


def overlap_picture(lines: Sequence[Line]) -> ImageArray:
    """Draw mean overlap over the frames since a true first box (the paper's figure 4)."""
    with drawing(4.6, 2.9) as figure:
        axes = figure.add_axes((0.11, 0.15, 0.86, 0.74))
        _plain(axes)
        for number, line in enumerate(lines):
            dashes = (3.0, 1.5) if "off" in line.name else (1.0, 0.0)
            axes.plot(
                np.arange(len(line.iou)), line.iou, color=TRACKS[number % len(TRACKS)],
                linewidth=1.4, dashes=dashes, label=line.name,
            )  # fmt: skip
        axes.set_ylim(0, 1.02)
        axes.set_xlim(0, max((len(line.iou) for line in lines), default=2) - 1)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("frames since the true first box")
        axes.set_ylabel("mean overlap from above")
        axes.grid(color=GRID, linewidth=0.4)
        axes.legend(frameon=False, loc="lower left", labelcolor=TEXT)
        axes.set_title("Overlap over time", loc="left", color=TEXT, fontsize=8)
        return rendered(figure)


def timeline_picture(title: str, lanes: Sequence[Lane]) -> ImageArray:
    """Draw a lane an object: grey where it is in sight, purple where hidden, coloured as found.

    The height of the coloured line in a lane is the overlap with the object.
    """
    height = 1.0 + 0.34 * max(len(lanes), 1)
    with drawing(6.8, height) as figure:
        bottom, top = 0.42 / height, 1 - 0.58 / height
        axes = figure.add_axes((0.2, bottom, 0.78, top - bottom))
        _plain(axes)
        for place, lane in enumerate(lanes):
            _draw_lane(axes, len(lanes) - 1 - place, lane)
        axes.set_yticks(range(len(lanes)), [lane.name for lane in reversed(lanes)])
        axes.set_ylim(-0.6, len(lanes) - 0.4)
        axes.set_xlabel("frame")
        figure.text(0.02, 1 - 0.2 / height, title, color=TEXT, fontsize=8, va="center")
        used = [name for name in _FOUND if any(name in lane.found for lane in lanes)]
        for number, name in enumerate([*used, "hidden"]):
            color = _FOUND.get(name, _HIDDEN)
            figure.text(
                0.2 + 0.11 * number, 1 - 0.42 / height, f"\u25a0 {name}", color=color, va="center"
            )
        return rendered(figure)


def _draw_lane(axes: Axes, row: int, lane: Lane) -> None:
    for hidden, color, reach in ((False, GRID, 0.42), (True, _HIDDEN, 0.48)):
        spans = [(frame - 0.5, 1.0) for frame in lane.frames[lane.hidden == hidden]]
        axes.broken_barh(spans, (row - reach, 2 * reach), color=color, linewidth=0)
    for name in dict.fromkeys(lane.found):
        own = np.array([found == name for found in lane.found])
        axes.bar(
            lane.tracked[own], 0.74 * np.maximum(lane.iou[own], 0.04), bottom=row - 0.37,
            width=0.72, color=_FOUND.get(name, MUTED), linewidth=0,
        )  # fmt: skip


def _plain(axes: Axes) -> None:
    axes.set_facecolor(PANEL)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
