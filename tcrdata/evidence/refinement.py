"""Refines the boxes of one track over all of its frames, in the world, seen from above.

Four passes of: heading from the smoothed path; size from quantiles of the extents over the track;
each axis anchored on the edge that faces the sensor, when that edge can be trusted; the anchors,
weighted by what they know, smoothed towards constant acceleration. A body turns about its rear
axle, so its centre slides outwards in a curve: the heading is the path's direction less
atan(distance to the rear axle * curvature).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcrdata.evidence.body_heading import body_heading, shape_headings
from tcrdata.evidence.path_smoothing import smooth_path
from tcrdata.evidence.sightings import RefinedPath, RefinementSettings, Sightings
from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, FloatArray, IntArray


@compiled
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


@dataclass(frozen=True)
class RefineTask:
    """Some tracks, for one worker; see `refine`."""

    tracks: tuple[Sightings, ...]
    settings: RefinementSettings
    interval_s: float


def refine_chunk(task: RefineTask) -> list[RefinedPath]:
    """Return the refined path of each track."""
    return [refine(track, task.settings, task.interval_s) for track in task.tracks]


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
    shape = shape_headings(sightings, settings)
    size = seen_size = (0.0, 0.0)
    residual = np.zeros((len(step), 2))
    for _ in range(settings.passes):
        yaw = body_heading(path, size[0], shape, step, settings, interval_s)
        seen = yaw[step]
        extents = _extents(sightings.xz, offsets, seen)
        shown = _shown(sightings, seen, path[step], size, settings)
        used = sightings.counts_for_size
        seen_size = _seen_size(extents, used, settings)
        size = _whole_size(seen_size, shown[used], settings)
        anchor, deviation = _anchors(sightings, extents, seen, path[step], size, settings)
        turn = _axes(seen)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
        slack = settings.outlier_deviations * deviation / np.maximum(np.abs(residual), 1e-9)
        inverse = np.minimum(1.0, slack) / deviation**2
        information = np.einsum("nki,nk,nkj->nij", turn, inverse, turn)
        world = np.einsum("nki,nk->ni", turn, anchor)
        path = smooth_path(step, world, information, count, jerk_m, acceleration_m)
        residual = anchor - np.einsum("nij,nj->ni", turn, path[step])
    yaw = body_heading(path, size[0], shape, step, settings, interval_s)
    return RefinedPath(
        path, yaw, *size, *seen_size, float(np.sqrt((residual**2).sum(axis=1).mean()))
    )


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


def _seen_size(
    extents: FloatArray, counts: BoolArray, settings: RefinementSettings
) -> tuple[float, float]:
    """Return length and width that the points show: quantiles of the extents.

    Args:
        extents: (n, 4) ends along both axes.
        counts: (n,) frames that may set the size, at least one.
        settings: scaled to the world.
    """
    length = quantile((extents[:, 1] - extents[:, 0])[counts], settings.length_quantile)
    width = quantile((extents[:, 3] - extents[:, 2])[counts], settings.width_quantile)
    return length + settings.pad_m, width + settings.pad_m


def quantile(values: FloatArray, share: float) -> float:
    """Return a quantile of (N,) numbers, N >= 1, as `np.quantile` has it, in a tenth of its time.

    Args:
        values: none of them NaN.
        share: in [0, 1].
    """
    place = (len(values) - 1) * share
    below = math.floor(place)
    above = min(below + 1, len(values) - 1)
    ordered = np.sort(values)
    low, high = float(ordered[below]), float(ordered[above])
    part = place - below
    if part >= 0.5:
        return high - (high - low) * (1 - part)
    return low + (high - low) * part


def _whole_size(
    seen_size: tuple[float, float], shown: BoolArray, settings: RefinementSettings
) -> tuple[float, float]:
    """Return length and width, one of them what a vehicle has where it never came into view.

    Args:
        seen_size: what the points show.
        shown: (n, 2) whether the sensor saw along the length, and along the width.
        settings: scaled to the world.
    """
    length, width = seen_size
    sees_length, sees_width = shown.mean(axis=0) >= 1 - np.array(
        [settings.length_quantile, settings.width_quantile]
    )
    if not sees_length and sees_width and width >= settings.vehicle_width_m:
        length = max(length, settings.vehicle_aspect * min(width, settings.vehicle_most_width_m))
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

    A side is when the line of sight meets it steeper than `grazing_share`, or sees the top, and
    neither of its ends hides behind something nearer.
    """
    away = sightings.sensor - center
    local = np.abs(np.einsum("nij,nj->ni", _axes(yaw), away))
    distance = np.maximum(np.hypot(*away.T), settings.pad_m)
    length_side = (local[:, 1] - size[1] / 2) / distance >= settings.grazing_share
    width_side = (local[:, 0] - size[0] / 2) / distance >= settings.grazing_share
    from_above = sightings.above_top_m / distance >= settings.grazing_share
    whole = ~(sightings.distrusted[:, ::2] | sightings.distrusted[:, 1::2])
    return np.stack([length_side | from_above, width_side | from_above], axis=1) & whole


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
