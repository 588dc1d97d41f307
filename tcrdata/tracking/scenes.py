"""What a tracker sees of one frame: points with features, candidate boxes, and the view.

Everything is in the world of the frame's segment: y points down, metres. A box is (x, y, z, length,
width, height, yaw) with KITTI's sense of yaw, as everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from tcrdata.tracking.cell_points import CellPoints
from tcrdata.tracking.near_points import hidden_rays, spread
from tcrdata.types import BoolArray, Float32Array, FloatArray


class View(Protocol):
    """Where a frame's sensor stood and what its rays hit first."""

    @property
    def origin(self) -> FloatArray:
        """(3,) place of the sensor in the world."""
        ...

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Cast rays from the sensor to (N, 3) world points.

        Returns:
            (N,) ranges of the points; (N,) ranges of the first return on each ray, infinite
            without a return, NaN for a ray outside the sensor's view.
        """
        ...


@dataclass(frozen=True)
class Candidates:
    """Boxes that something else found in a frame.

    Attributes:
        boxes: (M, 7).
        heat: (M,) in [0, 1]: 2D objectness times 3D objectness of each.
        starts: (M,) whether a tracklet may begin with it.
        names: the track that its finder linked it to; None without one.
    """

    boxes: FloatArray
    heat: FloatArray
    starts: BoolArray
    names: tuple[str | None, ...]

    @cached_property
    def turns(self) -> FloatArray:
        """(M, 2) cosine and sine of the boxes' yaws."""
        yaws = self.boxes[:, 6].tolist()
        return np.array([(math.cos(yaw), math.sin(yaw)) for yaw in yaws]).reshape(-1, 2)


@dataclass(frozen=True)
class Scene:
    """One frame.

    Attributes:
        frame: its number.
        points: N of them, without the ground.
        features: (N, C) float32 of unit length: what correlation compares.
        candidates: boxes that tracklets may take.
        view: for visibility.
    """

    frame: int
    points: CellPoints
    features: Float32Array
    candidates: Candidates
    view: View


@dataclass(frozen=True)
class BoxView:
    """What a frame shows of a box.

    Attributes:
        visible_share: share of rays to the box that nothing stops before it; rays outside the view
            count as stopped.
    """

    visible_share: float


_SAMPLES = np.array(
    [[u, v, w] for u in (-0.4, -0.2, 0, 0.2, 0.4) for v in (-0.3, 0, 0.3) for w in (-0.35, 0, 0.35)]
)


def look(view: View, box: FloatArray, margin_m: float) -> BoxView:
    """Cast rays to a (7,) box.

    Args:
        view: of the frame.
        box: in the world.
        margin_m: a return must be this much nearer than the box to hide it.
    """
    turn = math.cos(box[6]), math.sin(box[6])
    points = spread(_SAMPLES, box, turn)
    ranges, nearest = view.nearest(points)
    hidden = hidden_rays(view.origin, points, box, turn, ranges, nearest, margin_m)
    return BoxView(1 - hidden / len(points))


def from_box(points: FloatArray, box: FloatArray) -> FloatArray:
    """Return (N, 3) world points that lie so in a box: shares of its length, height and width."""
    return spread(points, box, (math.cos(box[6]), math.sin(box[6])))
