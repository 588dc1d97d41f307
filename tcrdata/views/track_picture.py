"""The whole clip from above: where the camera drove and where the labelled objects went."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import FloatArray
from tcrdata.views.canvas import drawing, png_bytes, rendered
from tcrdata.views.palette import EGO, GRID, PANEL, TEXT, TRACKS

_SIZE_IN = 5.0
_MARGIN_SHARE = 0.06
_FRAMES_A_TICK = 10


def track_picture(
    first_T_level: FloatArray,
    tracks: Mapping[str, tuple[NDArray[np.integer], NDArray[np.floating]]],
    title: str = "",
) -> bytes:
    """Return a PNG of the ego path, with a dot every ten frames, and of each track.

    Args:
        first_T_level: (F, 4, 4) poses: each frame's level coordinates to the first one's.
        tracks: name to (n,) places in `first_T_level` and the (n, 7) boxes in those frames.
        title: one line.
    """
    moved = {name: _moved(first_T_level[at], boxes) for name, (at, boxes) in tracks.items()}
    with drawing(_SIZE_IN, _SIZE_IN) as figure:
        axes = figure.add_axes((0.09, 0.08, 0.88, 0.86))
        axes.set_facecolor(PANEL)
        axes.grid(color=GRID, linewidth=0.5)
        axes.tick_params(length=0)
        for number, name in enumerate(sorted(moved)):
            _draw_track(axes, moved[name], TRACKS[number % len(TRACKS)])
        path = first_T_level[:, [0, 2], 3]
        axes.plot(path[:, 0], path[:, 1], color=EGO, linewidth=1.4, zorder=5)
        dots = path[::_FRAMES_A_TICK]
        axes.plot(dots[:, 0], dots[:, 1], "o", color=EGO, markersize=2.5, zorder=5)
        axes.annotate(
            "camera", path[-1], (4, 4), textcoords="offset points", color=EGO, fontsize=6, zorder=6
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(_MARGIN_SHARE)
        axes.set_xlabel("x, m (right)")
        axes.set_ylabel("z, m (ahead)")
        axes.set_title(title, fontsize=8, color=TEXT, loc="left")
        return png_bytes(rendered(figure))


def _moved(poses: FloatArray, boxes: NDArray[np.floating]) -> FloatArray:
    """Carry (n, 7) boxes by (n, 4, 4) poses; the heading turns with them."""
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7).copy()
    yaw = boxes[:, 6]
    heading = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    heading = np.einsum("nij,nj->ni", poses[:, :3, :3], heading)
    boxes[:, :3] = np.einsum("nij,nj->ni", poses[:, :3, :3], boxes[:, :3]) + poses[:, :3, 3]
    boxes[:, 6] = np.arctan2(-heading[:, 2], heading[:, 0])
    return boxes


def _draw_track(axes: Axes, boxes: FloatArray, color: str) -> None:
    axes.plot(boxes[:, 0], boxes[:, 2], color=color, linewidth=1.0, zorder=3)
    for corners in box_corners_bev(boxes[[0, -1]]):
        ring = np.concatenate([corners, corners[:1]])
        axes.plot(ring[:, 0], ring[:, 1], color=color, linewidth=0.8, zorder=4)
    tip = boxes[-1, [0, 2]]
    ahead = tip + 0.5 * boxes[-1, 3] * np.array([np.cos(boxes[-1, 6]), -np.sin(boxes[-1, 6])])
    axes.plot([tip[0], ahead[0]], [tip[1], ahead[1]], color=color, linewidth=0.8, zorder=4)
