"""A rigid template of an object in features, and its 3D cross-correlation with a frame's points.

The template is a volume of feature vectors in the object's own axes, smoothed so that it can be
matched finer than its voxels. A pose is scored by `sum_i f_i . T(pose^-1 x_i)` over the frame's
points: the cross-correlation of the template with the (sparse) volume of the frame's features.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import SettingsError
from tcrdata.tracking.cell_points import CellPoints, near
from tcrdata.tracking.near_points import blurred
from tcrdata.tracking.volumes import (
    best_pose,
    correlations,
    in_voxels,
    poses_in_voxels,
    rough_correlations,
    splat,
)
from tcrdata.types import Float32Array, FloatArray

BLUR = np.exp(-0.5 * np.arange(-2, 3) ** 2)  # a Gaussian of one voxel, cut at two
BLUR /= BLUR.sum()


@dataclass(frozen=True)
class CorrelationSettings:
    """How templates are made and searched for; metres are multiplied by the metric scale.

    Attributes:
        voxel_m: side of a voxel.
        margin_m: a template reaches this far beyond its box.
        most_points: points of a frame that are matched, at most.
        reach_m: the search goes this far from the prediction, along either axis.
        lift_m: and this far up and down.
        yaw_rad: the turns that are tried lie this far apart.
        fade: share of a template that an update keeps.
        away_cost: what a pose at the edge of the search loses, in shares of a perfect match: within
            a voxel a template hardly tells poses apart, and what stands must not creep.
    """

    voxel_m: float = 0.15
    margin_m: float = 0.3
    most_points: int = 160
    reach_m: float = 0.6
    lift_m: float = 0.3
    yaw_rad: float = 0.07
    fade: float = 0.95
    away_cost: float = 0.05

    def __post_init__(self) -> None:
        """Refuse what no volume and no search can be made of.

        Raises:
            SettingsError: a length, or a number of points, that is not above 0.
        """
        for name in ("voxel_m", "most_points", "reach_m"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"track.short.correlation.{name}: above 0")

    def scaled(self, metric_scale: float) -> CorrelationSettings:
        """Return the settings with metres of this world."""
        return replace(
            self,
            voxel_m=self.voxel_m * metric_scale,
            margin_m=self.margin_m * metric_scale,
            reach_m=self.reach_m * metric_scale,
            lift_m=self.lift_m * metric_scale,
        )


@dataclass(frozen=True)
class Template:
    """What an object looks like.

    Attributes:
        raw: (U, V, W, C) float32, features summed into voxels along length, down, and width.
        volume: the same, smoothed and scaled: its own points score 1 in the mean.
        first: (3,) the centre of the first voxel in the object's axes, metres.
        voxel_m: side of a voxel.
        points: points of the object in the frame that was seen last.
        lineage: names the frames and boxes that it was made of; empty where nobody asks.
    """

    raw: Float32Array
    volume: Float32Array
    first: FloatArray
    voxel_m: float
    points: int
    lineage: bytes = b""


@dataclass(frozen=True)
class Pose:
    """Where a template fits best.

    Attributes:
        box: (7,), moved and turned.
        score: mean of the correlation over the points in the box; 1 is as good as the own ones.
        points: how many these are.
    """

    box: FloatArray
    score: float
    points: int


def make_template(
    box: FloatArray, points: CellPoints, features: Float32Array, settings: CorrelationSettings
) -> Template | None:
    """Return the template of the points in a (7,) box; None without any."""
    half = box[[3, 5, 4]] / 2 + settings.margin_m
    inside, local = near(box, points, half - settings.margin_m / 2)
    if not len(inside):
        return None
    shape = tuple(np.maximum(np.ceil(2 * half / settings.voxel_m).astype(int), 3))
    raw = np.zeros((*shape, features.shape[1]), np.float32)
    chosen = np.ascontiguousarray(features[inside])
    first = settings.voxel_m / 2 - half
    places = in_voxels(local, first, settings.voxel_m)
    splat(raw, places, chosen)
    return _template(raw, places, chosen, first, settings.voxel_m)


def updated(
    template: Template,
    box: FloatArray,
    points: CellPoints,
    features: Float32Array,
    settings: CorrelationSettings,
) -> Template:
    """Return a template that has also seen the points in its (7,) box in another frame."""
    inside, local = near(box, points, box[[3, 5, 4]] / 2 + settings.margin_m / 2)
    if not len(inside) or not _comparable(template, features):
        return template
    raw = template.raw * np.float32(settings.fade)
    chosen = np.ascontiguousarray(features[inside])
    places = in_voxels(local, template.first, template.voxel_m)
    splat(raw, places, chosen)
    return _template(raw, places, chosen, template.first, template.voxel_m)


def correlate(
    template: Template,
    box: FloatArray,
    points: CellPoints,
    features: Float32Array,
    settings: CorrelationSettings,
) -> Pose | None:
    """Return where a template fits best around a predicted (7,) box; None without points there."""
    reach = settings.reach_m
    half = box[[3, 5, 4]] / 2
    inside, local = near(box, points, half + reach)
    if not len(inside) or not _comparable(template, features):
        return None
    stride = -(-len(inside) // settings.most_points)
    chosen = inside[::stride]
    places = in_voxels(local[::stride], template.first, template.voxel_m)
    best = _best_offset(template, places, features[chosen], half, settings)
    moved = _moved(box, best)
    there, at = near(moved, points, half + template.voxel_m / 2)
    if not len(there):
        return None
    fit = _fit(template.volume, in_voxels(at, template.first, template.voxel_m), features[there])
    return Pose(moved, fit, len(there))


def _best_offset(
    template: Template,
    places: Float32Array,
    features: Float32Array,
    half: FloatArray,
    settings: CorrelationSettings,
) -> FloatArray:
    """Return (along, down, across, turn) at which (N, 3) places in voxels fit best, less the way.

    The widest search asks the nearest voxels: a template is smooth enough to be found so.
    """
    v = template.voxel_m
    cost = settings.away_cost * len(places) / settings.reach_m
    arm = float(np.hypot(half[0], half[2]))
    centre = (-template.first / v).astype(np.float32)
    best = np.zeros(4)
    for step, offsets in enumerate(_searched(v, settings)):
        score = correlations if step else rough_correlations
        poses = poses_in_voxels(best, offsets, 1 / v)
        scores = score(template.volume, places, features, centre, poses)
        best = best + offsets[best_pose(scores, best, offsets, cost, arm)]
    return best


def _fit(volume: Float32Array, places: Float32Array, features: Float32Array) -> float:
    """Return the mean correlation of (N, C) features where they are."""
    still, centre = np.zeros((1, 4), np.float32), np.zeros(3, np.float32)
    return float(correlations(volume, places, features, centre, still)[0]) / len(places)


def _comparable(template: Template, features: Float32Array) -> bool:
    """Whether features are of the template's kind: a frame may lack its image or its evidence."""
    return bool(template.raw.shape[3] == features.shape[1])


@lru_cache(maxsize=8)
def _searched(v: float, settings: CorrelationSettings) -> tuple[FloatArray, ...]:
    """Return the (N, 4) offsets (along, down, across, turn) that are tried, one set on another.

    Steps of a voxel v over the ground, up and down; then turns; then steps of a third and a ninth.
    """
    yaw = settings.yaw_rad
    steps, lifts = (
        np.arange(-int(reach / v + 1e-6), int(reach / v + 1e-6) + 1) * v
        for reach in (settings.reach_m, settings.lift_m)
    )
    return (
        _grid(steps, lifts, steps, np.zeros(1)),
        _grid(np.array([-v, 0, v]), np.zeros(1), np.array([-v, 0, v]), np.arange(-2, 3) * yaw),
        _grid(*[np.arange(-1, 2) * v / 3] * 3, np.array([-yaw / 2, 0.0, yaw / 2])),
        _grid(*[np.arange(-1, 2) * v / 9] * 3, np.zeros(1)),
    )


def _moved(box: FloatArray, offset: FloatArray) -> FloatArray:
    """Return a box moved along its own axes by (along, down, across) and turned."""
    c, s = np.cos(box[6]), np.sin(box[6])
    result = box.copy()
    result[0] += c * offset[0] + s * offset[2]
    result[1] += offset[1]
    result[2] += -s * offset[0] + c * offset[2]
    result[6] += offset[3]
    return result


def _grid(*axes: NDArray[np.floating[Any]]) -> FloatArray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)


def _template(
    raw: Float32Array,
    places: Float32Array,
    features: Float32Array,
    first: FloatArray,
    voxel_m: float,
) -> Template:
    """Blur by a voxel, and scale so that the points that it was made of score 1 in the mean.

    Nothing is clipped: a template fits its own points best where they are, not beside.
    """
    volume = blurred(raw, BLUR)
    own = _fit(volume, places, features)
    volume = np.ascontiguousarray(volume / np.float32(max(own, 1e-9)))
    return Template(raw, volume, first, voxel_m, len(places))
