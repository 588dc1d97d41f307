"""What a tracker sees of one frame: points with features, candidate boxes, and the view.

Everything is in the world of the frame's segment: y points down, metres. A box is (x, y, z, length,
width, height, yaw) with KITTI's sense of yaw, as everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

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


@dataclass(frozen=True)
class Scene:
    """One frame.

    Attributes:
        frame: its number.
        points: (N, 3) float32 without the ground.
        features: (N, C) float32 of unit length: what correlation compares.
        candidates: boxes that tracklets may take.
        view: for visibility.
    """

    frame: int
    points: Float32Array
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
    points = from_box(_SAMPLES * box[[3, 5, 4]], box)
    ranges, nearest = view.nearest(points)
    entry = _entry(view.origin, points, box)
    with np.errstate(invalid="ignore"):
        hidden = np.isnan(nearest) | (nearest < entry * ranges - margin_m)
    return BoxView(float(1 - hidden.mean()))


def _entry(origin: FloatArray, points: FloatArray, box: FloatArray) -> FloatArray:
    """Return where rays to (N, 3) points of a box enter it, as shares of the way there."""
    start = to_box(origin[None], box)[0]
    way = to_box(points, box) - start
    half = np.maximum(box[[3, 5, 4]] / 2, 1e-6)
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)
    near, far = (-half - start) / way, (half - start) / way
    return np.asarray(np.maximum(np.minimum(near, far).max(axis=1), 0.0))


def to_box(points: FloatArray, box: FloatArray) -> FloatArray:
    """Return (N, 3) world points from a box's centre along its length, down, and its width."""
    c, s = math.cos(box[6]), math.sin(box[6])
    dx, dz = points[:, 0] - box[0], points[:, 2] - box[2]
    return np.column_stack([c * dx - s * dz, points[:, 1] - box[1], s * dx + c * dz])


def from_box(points: FloatArray, box: FloatArray) -> FloatArray:
    """Return `to_box` undone."""
    c, s = math.cos(box[6]), math.sin(box[6])
    along, across = points[:, 0], points[:, 2]
    return np.column_stack(
        [box[0] + c * along + s * across, box[1] + points[:, 1], box[2] - s * along + c * across]
    )
