"""Where a body points: along its path, less what it slips in a curve, and as its outline lies."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tcrdata.evidence.path_smoothing import (
    HeadingModel,
    course,
    gradient,
    smooth_heading,
    wrapped,
)
from tcrdata.evidence.sightings import RefinementSettings, Sightings
from tcrdata.geometry.boxes import l_shape_box
from tcrdata.types import FloatArray, IntArray


@dataclass(frozen=True)
class ShapeHeadings:
    """How each frame's outline lies, (n,) each; the weight is 1 / rad^2."""

    yaw: FloatArray
    weight: FloatArray


def shape_headings(sightings: Sightings, settings: RefinementSettings) -> ShapeHeadings:
    """Return the L-shape headings; they count by the length seen beyond `shape_least_m`."""
    spans = pairwise(sightings.offsets.tolist())
    boxes = [l_shape_box(sightings.xz[a:b], settings.path_m) for a, b in spans]
    length = np.array([box.length for box in boxes])
    weight = (np.maximum(length - settings.shape_least_m, 0.0) / settings.shape_m) ** 2
    return ShapeHeadings(np.array([box.yaw_rad for box in boxes]), weight)


def body_heading(
    path: FloatArray,
    length: float,
    shape: ShapeHeadings,
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
    step = np.hypot(*gradient(path).T)
    curvature = gradient(yaw) / np.maximum(step, settings.path_m)
    limit = settings.curvature_1pm
    return np.asarray(np.arctan(settings.slip_share * length * np.clip(curvature, -limit, limit)))
