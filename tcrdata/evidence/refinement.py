"""Refines the boxes of one track over all of its frames, in the world, seen from above.

Four passes of: heading from the smoothed path; size from quantiles of the extents over the track;
each axis anchored on the edge that faces the sensor, when that edge can be trusted; the anchors,
weighted by what they know, smoothed towards constant acceleration. A body turns about its rear
axle, so its centre slides outwards in a curve: the heading is the path's direction less
atan(distance to the rear axle * curvature).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numba
import numpy as np

from tcrdata.evidence.path_smoothing import (
    HeadingModel,
    course,
    smooth_heading,
    smooth_path,
    wrapped,
)
from tcrdata.geometry.boxes import l_shape_box
from tcrdata.types import BoolArray, FloatArray, IntArray

_Function = TypeVar("_Function", bound=Callable[..., object])
_compiled: Callable[[_Function], _Function] = numba.njit(cache=True)


@dataclass(frozen=True)
class RefinementSettings:
    """How a track is refined; metres are multiplied by the metric scale.

    Attributes:
        passes: rounds of heading, size, anchors and smoothing.
        length_quantile: of the extents along the heading, over the frames.
        width_quantile: of the extents across it.
        pad_m: added to both, for what the outermost points miss.
        anchor_m: standard deviation of a trusted edge.
        anchor_share: the same, a metre of range.
        outlier_deviations: anchors farther off than this lose weight (Huber).
        jerk_mps3: standard deviation of the path's jerk.
        acceleration_mps2: standard deviation of the path's acceleration.
        path_m: standard deviation of a smoothed path's step across it.
        turn_radps2: standard deviation of the change of the turning rate.
        curvature_1pm: standard deviation of the curvature, 1 / m.
        still_radps: turning rate of a body at rest.
        slip_share: distance from the centre to the rear axle, in lengths.
        shape_m: standard deviation of an outline's heading, times the length seen.
        shape_least_m: what is seen of less than this has no heading.
        shape_outlier_rad: outlines farther off than this lose weight (Huber).
        grazing_share: sine of the angle at which a side shows its extent.
        vehicle_width_m: what is wider, and never showed its length, is taken for a vehicle.
        vehicle_length_m: what is longer, and never showed its width, is too.
        vehicle_aspect: length over width of a vehicle.
        vehicle_most_width_m: width that a vehicle of unknown width has at most.
    """

    passes: int = 4
    length_quantile: float = 0.9
    width_quantile: float = 0.8
    pad_m: float = 0.05
    anchor_m: float = 0.1
    anchor_share: float = 0.003
    outlier_deviations: float = 2.0
    jerk_mps3: float = 3.0
    acceleration_mps2: float = 10.0
    path_m: float = 0.05
    turn_radps2: float = 0.5
    curvature_1pm: float = 0.2
    still_radps: float = 0.05
    slip_share: float = 0.3
    shape_m: float = 0.3
    shape_least_m: float = 1.0
    shape_outlier_rad: float = 0.2
    grazing_share: float = 0.15
    vehicle_width_m: float = 1.4
    vehicle_length_m: float = 3.0
    vehicle_aspect: float = 2.3
    vehicle_most_width_m: float = 1.8

    def scaled(self, metric_scale: float) -> RefinementSettings:
        """Return the settings of a world whose road scene is `metric_scale` as large."""
        names = [
            name for name in self.__dataclass_fields__ if name.endswith(("_m", "_mps3", "_mps2"))
        ]
        lengths = {name: getattr(self, name) * metric_scale for name in names}
        return replace(self, curvature_1pm=self.curvature_1pm / metric_scale, **lengths)


@dataclass(frozen=True)
class Sightings:
    """What was seen of one object, n frames, world, from above.

    Attributes:
        step: (n,) frames since the track's first, rising, from 0.
        xz: (M, 2) points of all frames, one after another, metres.
        offsets: (n + 1,) where each frame's points begin and end; no frame is empty.
        sensor: (n, 2) the sensor.
        distrusted: (n, 4) edges whose end is hidden by something nearer: rear, front, and low and
            high side across the heading.
        counts_for_size: (n,) frames whose extents may set the size.
        above_top_m: (n,) how far the sensor is above the highest point.
    """

    step: IntArray
    xz: FloatArray
    offsets: IntArray
    sensor: FloatArray
    distrusted: BoolArray
    counts_for_size: BoolArray
    above_top_m: FloatArray


@dataclass(frozen=True)
class RefinedPath:
    """A refined track on every step from its first sighting to its last.

    Attributes:
        center: (N, 2) x and z, world, metres.
        yaw_rad: (N,) heading, world, continuous.
        length: metres.
        width: metres.
        residual_m: root mean square distance of the anchors to the smoothed path.
    """

    center: FloatArray
    yaw_rad: FloatArray
    length: float
    width: float
    residual_m: float


@_compiled
def _extents(xz: FloatArray, offsets: IntArray, yaw: FloatArray) -> FloatArray:
    """Return (n, 4): low and high end along the heading, low and high end across it."""
    result = np.empty((len(yaw), 4))
    for i in range(len(yaw)):
        c, s = math.cos(yaw[i]), math.sin(yaw[i])
        result[i, 0] = result[i, 2] = np.inf
        result[i, 1] = result[i, 3] = -np.inf
        for j in range(offsets[i], offsets[i + 1]):
            along = xz[j, 0] * c - xz[j, 1] * s
            across = xz[j, 0] * s + xz[j, 1] * c
            result[i, 0], result[i, 1] = min(result[i, 0], along), max(result[i, 1], along)
            result[i, 2], result[i, 3] = min(result[i, 2], across), max(result[i, 3], across)
    return result


def refine(sightings: Sightings, settings: RefinementSettings, interval_s: float) -> RefinedPath:
    """Return the refined path of one track.

    Args:
        sightings: the track's points, frame by frame.
        settings: scaled to the world.
        interval_s: seconds a step.
    """
    step, offsets = sightings.step, sightings.offsets
    count = int(step[-1]) + 1
    jerk_m = settings.jerk_mps3 * interval_s**3
    acceleration_m = settings.acceleration_mps2 * interval_s**2
    middle = _middles(sightings)
    information = np.broadcast_to(np.eye(2) / (4 * settings.anchor_m) ** 2, (len(step), 2, 2))
    path = smooth_path(step, middle, information, count, jerk_m, acceleration_m)
    shape = _shape_headings(sightings, settings)
    length = width = 0.0
    residual = np.zeros((len(step), 2))
    for _ in range(settings.passes):
        yaw = _heading(path, length, shape, step, settings, interval_s)
        seen = yaw[step]
        extents = _extents(sightings.xz, offsets, seen)
        shown = _shown(sightings, seen, path[step], (length, width), settings)
        length, width = _size(extents, shown, sightings.counts_for_size, settings)
        anchor, deviation = _anchors(
            sightings, extents, seen, path[step], (length, width), settings
        )
        turn = _axes(seen)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
        slack = settings.outlier_deviations * deviation / np.maximum(np.abs(residual), 1e-9)
        inverse = np.minimum(1.0, slack) / deviation**2
        information = np.einsum("nki,nk,nkj->nij", turn, inverse, turn)
        world = np.einsum("nki,nk->ni", turn, anchor)
        path = smooth_path(step, world, information, count, jerk_m, acceleration_m)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
    yaw = _heading(path, length, shape, step, settings, interval_s)
    return RefinedPath(path, yaw, length, width, float(np.sqrt((residual**2).sum(axis=1).mean())))


def _middles(sightings: Sightings) -> FloatArray:
    """Return (n, 2) middles of each frame's points: of their span along x and z."""
    offsets = sightings.offsets[:-1]
    low = np.minimum.reduceat(sightings.xz, offsets, axis=0)
    high = np.maximum.reduceat(sightings.xz, offsets, axis=0)
    return np.asarray((low + high) / 2)


def _axes(yaw: FloatArray) -> FloatArray:
    """Return (n, 2, 2) rows: the length axis and the width axis in (x, z)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)


def _heading(
    path: FloatArray,
    length: float,
    shape: _ShapeHeadings,
    step: IntArray,
    settings: RefinementSettings,
    interval_s: float,
) -> FloatArray:
    """Return the (N,) body's heading: from the path, and from how its outline lies."""
    model = HeadingModel(
        settings.turn_radps2 * interval_s**2,
        settings.curvature_1pm,
        settings.still_radps * interval_s,
    )
    direction, weight = course(path, settings.path_m)
    yaw = smooth_heading(direction, weight, path, model)
    for _ in range(2):
        angles, weights = (direction - _slip(yaw, path, length, settings)) * weight, weight.copy()
        # A rectangle lies the same way after a quarter turn.
        off = wrapped(shape.yaw - yaw[step], np.pi / 2)
        trust = shape.weight / np.maximum(1.0, np.abs(off) / settings.shape_outlier_rad)
        angles[step] += (yaw[step] + off) * trust
        weights[step] += trust
        yaw = smooth_heading(angles / np.maximum(weights, 1e-12), weights, path, model)
    return yaw


def _slip(
    yaw: FloatArray, path: FloatArray, length: float, settings: RefinementSettings
) -> FloatArray:
    """Return (N,) by how much the course of the centre turns ahead of the body."""
    if len(path) < 3:
        return np.zeros(len(path))
    step = np.hypot(*np.gradient(path, axis=0).T)
    curvature = np.gradient(yaw) / np.maximum(step, settings.path_m)
    limit = settings.curvature_1pm
    return np.asarray(np.arctan(settings.slip_share * length * np.clip(curvature, -limit, limit)))


@dataclass(frozen=True)
class _ShapeHeadings:
    """How each frame's outline lies, (n,) each; the weight is 1 / rad^2."""

    yaw: FloatArray
    weight: FloatArray


def _shape_headings(sightings: Sightings, settings: RefinementSettings) -> _ShapeHeadings:
    """Return the L-shape headings; they count by the length seen beyond `shape_least_m`."""
    spans = pairwise(sightings.offsets.tolist())
    boxes = [l_shape_box(sightings.xz[a:b], settings.path_m) for a, b in spans]
    length = np.array([box.length for box in boxes])
    weight = (np.maximum(length - settings.shape_least_m, 0.0) / settings.shape_m) ** 2
    return _ShapeHeadings(np.array([box.yaw_rad for box in boxes]), weight)


def _size(
    extents: FloatArray,
    shown: BoolArray,
    counts: BoolArray,
    settings: RefinementSettings,
) -> tuple[float, float]:
    """Return length and width: quantiles of the extents, or what a vehicle of that side has.

    Args:
        extents: (n, 4) ends along both axes.
        shown: (n, 2) whether the sensor saw along the length, and along the width.
        counts: (n,) frames that may set the size.
        settings: scaled to the world.
    """
    used = counts if counts.any() else np.ones(len(counts), dtype=bool)
    length = float(np.quantile((extents[:, 1] - extents[:, 0])[used], settings.length_quantile))
    width = float(np.quantile((extents[:, 3] - extents[:, 2])[used], settings.width_quantile))
    length, width = length + settings.pad_m, width + settings.pad_m
    sees_length, sees_width = shown[used].mean(axis=0) >= 1 - np.array(
        [settings.length_quantile, settings.width_quantile]
    )
    if not sees_length and sees_width and width >= settings.vehicle_width_m:
        length = max(length, settings.vehicle_aspect * width)
    if not sees_width and sees_length and length >= settings.vehicle_length_m:
        width = max(width, min(length / settings.vehicle_aspect, settings.vehicle_most_width_m))
    return length, width


def _shown(
    sightings: Sightings,
    yaw: FloatArray,
    center: FloatArray,
    size: tuple[float, float],
    settings: RefinementSettings,
) -> BoolArray:
    """Return (n, 2): whether the side along the length, and the one along the width, is in view.

    A side is when the line of sight meets it steeper than `grazing_share`, or sees the top.
    """
    away = sightings.sensor - center
    local = np.abs(np.einsum("nij,nj->ni", _axes(yaw), away))
    distance = np.maximum(np.hypot(*away.T), settings.pad_m)
    length_side = (local[:, 1] - size[1] / 2) / distance >= settings.grazing_share
    width_side = (local[:, 0] - size[0] / 2) / distance >= settings.grazing_share
    from_above = sightings.above_top_m / distance >= settings.grazing_share
    return np.stack([length_side | from_above, width_side | from_above], axis=1)


def _anchors(
    sightings: Sightings,
    extents: FloatArray,
    yaw: FloatArray,
    center: FloatArray,
    size: tuple[float, float],
    settings: RefinementSettings,
) -> tuple[FloatArray, FloatArray]:
    """Return (n, 2) centres along both axes and their standard deviations.

    An edge that faces the sensor gives the centre at half a size from it. Otherwise the centre is
    only known to lie where the box can cover the points: the middle, give or take the slack.
    """
    turn = _axes(yaw)
    sensor = np.einsum("nij,nj->ni", turn, sightings.sensor)
    box = np.einsum("nij,nj->ni", turn, center)
    base = settings.anchor_m + settings.anchor_share * np.hypot(*(sightings.sensor - center).T)
    anchor, deviation = np.empty_like(box), np.empty_like(box)
    for axis in range(2):
        low, high = extents[:, 2 * axis], extents[:, 2 * axis + 1]
        half = size[axis] / 2
        sees_low = (sensor[:, axis] < box[:, axis] - half) & ~sightings.distrusted[:, 2 * axis]
        sees_high = (sensor[:, axis] > box[:, axis] + half) & ~sightings.distrusted[:, 2 * axis + 1]
        slack = np.maximum(half - (high - low) / 2, 0.0)
        pad = settings.pad_m / 2
        anchor[:, axis] = np.where(
            sees_low,
            low - pad + half,
            np.where(sees_high, high + pad - half, (low + high) / 2),
        )
        deviation[:, axis] = base + np.where(sees_low | sees_high, 0.0, slack)
    return anchor, deviation
