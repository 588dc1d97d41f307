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
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np

from tcrdata.evidence.path_smoothing import smooth_heading, smooth_path
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

    def scaled(self, metric_scale: float) -> RefinementSettings:
        """Return the settings of a world whose road scene is `metric_scale` as large."""
        from dataclasses import replace

        return replace(
            self,
            pad_m=self.pad_m * metric_scale,
            anchor_m=self.anchor_m * metric_scale,
            jerk_mps3=self.jerk_mps3 * metric_scale,
            acceleration_mps2=self.acceleration_mps2 * metric_scale,
            path_m=self.path_m * metric_scale,
            curvature_1pm=self.curvature_1pm / metric_scale,
        )


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
    """

    step: IntArray
    xz: FloatArray
    offsets: IntArray
    sensor: FloatArray
    distrusted: BoolArray
    counts_for_size: BoolArray


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
    length = width = 0.0
    residual = np.zeros((len(step), 2))
    for _ in range(settings.passes):
        yaw = _heading(path, length, settings, interval_s)
        seen = yaw[step]
        extents = _extents(sightings.xz, offsets, seen)
        length, width = _size(extents, sightings.counts_for_size, settings)
        anchor, deviation = _anchors(
            sightings, extents, seen, path[step], (length, width), settings
        )
        inverse = 1 / deviation**2
        turn = _axes(seen)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
        inverse *= np.minimum(
            1.0, settings.outlier_deviations * deviation / np.maximum(np.abs(residual), 1e-9)
        )
        information = np.einsum("nki,nk,nkj->nij", turn, inverse, turn)
        world = np.einsum("nki,nk->ni", turn, anchor)
        path = smooth_path(step, world, information, count, jerk_m, acceleration_m)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
    yaw = _heading(path, length, settings, interval_s)
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
    path: FloatArray, length: float, settings: RefinementSettings, interval_s: float
) -> FloatArray:
    direction = smooth_heading(
        path,
        settings.path_m,
        settings.turn_radps2 * interval_s**2,
        settings.curvature_1pm,
        settings.still_radps * interval_s,
    )
    if len(path) < 3:
        return direction
    step = np.hypot(*np.gradient(path, axis=0).T)
    curvature = np.gradient(direction) / np.maximum(step, settings.path_m)
    limit = settings.curvature_1pm
    return np.asarray(
        direction - np.arctan(settings.slip_share * length * np.clip(curvature, -limit, limit))
    )


def _size(
    extents: FloatArray, counts: BoolArray, settings: RefinementSettings
) -> tuple[float, float]:
    used = extents[counts] if counts.any() else extents
    length = float(np.quantile(used[:, 1] - used[:, 0], settings.length_quantile))
    width = float(np.quantile(used[:, 3] - used[:, 2], settings.width_quantile))
    return length + settings.pad_m, width + settings.pad_m


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
