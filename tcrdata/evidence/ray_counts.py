"""What the rays of one sweep say of boxes: how many reach each, and how many of those it stops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array, FloatArray, IntArray

_BINS = 720


class Rays(NamedTuple):
    """The rays of a sweep by azimuth; a ray ends at its return.

    Attributes:
        ends: (N, 3) float32, metres from the sensor, axes of the level frame.
        ground: (N,) whether the return is ground.
        starts: (bins + 1,) first ray of each azimuth bin.
        sensor: (3,) where all begin, level frame.
    """

    ends: Float32Array
    ground: BoolArray
    starts: IntArray
    sensor: FloatArray


def rays_of(xyz: Float32Array, ground: BoolArray, sensor: FloatArray) -> Rays:
    """Return the rays to (N, 3) level points from (3,) a sensor's place."""
    ends = (xyz - sensor.astype(np.float32)).astype(np.float32)
    turned = (np.arctan2(ends[:, 0], ends[:, 2]) + np.float32(np.pi)) * (_BINS / (2 * np.pi))
    bins = np.clip(turned.astype(np.int16), 0, _BINS - 1)
    order = np.argsort(bins, kind="stable")
    starts = np.searchsorted(bins[order], np.arange(_BINS + 1))
    return Rays(ends[order], ground[order], starts.astype(np.int64), sensor)


def ray_counts(
    rays: Rays, boxes: NDArray[np.floating], cores: NDArray[np.floating], margin_m: float
) -> tuple[IntArray, IntArray]:
    """Return for each of (N, 7) level boxes how many rays end in it, and how many pass through.

    Those are asked that meet the box's core; one that ends before the box says nothing of it. One
    that ends on the ground behind the core, or below, has passed through.

    Args:
        rays: of the sweep.
        boxes: level frame, metres.
        cores: (N, 7) the parts that an object surely fills, within the boxes.
        margin_m: a return this far outside of the box along its ray still is the box's.
    """
    stopped = np.zeros(len(boxes), np.int64)
    passed = np.zeros(len(boxes), np.int64)
    own, inner = (np.array(kind, dtype=np.float64).reshape(-1, 7) for kind in (boxes, cores))
    own[:, :3] -= rays.sensor
    inner[:, :3] -= rays.sensor
    flat = np.hypot(own[:, 0], own[:, 2])
    reach = np.hypot(own[:, 3], own[:, 4]) / 2
    # A sensor above the box's circle sees it in every direction.
    half = np.where(reach < flat, np.arcsin(np.minimum(reach / np.maximum(flat, 1e-9), 1.0)), np.pi)
    middle = np.arctan2(own[:, 0], own[:, 2]) + np.pi
    bins = np.column_stack([middle - half, middle + half]) * (_BINS / (2 * np.pi))
    first, last = np.floor(bins[:, 0]).astype(np.int64), np.floor(bins[:, 1]).astype(np.int64)
    last = np.minimum(last, first + _BINS - 1)
    _count(rays.ends, rays.ground, rays.starts, own, inner, first, last, margin_m, stopped, passed)
    return stopped, passed


@compiled
def _count(
    ends: Float32Array,
    ground: BoolArray,
    starts: IntArray,
    boxes: FloatArray,
    cores: FloatArray,
    first: IntArray,
    last: IntArray,
    margin_m: float,
    stopped: IntArray,
    passed: IntArray,
) -> None:
    for b in range(len(boxes)):
        for number in range(first[b], last[b] + 1):
            cell = number % _BINS
            for i in range(starts[cell], starts[cell + 1]):
                length, enters, leaves = _crossing(ends[i], cores[b])
                if leaves < enters:
                    continue
                if ground[i]:
                    passed[b] += length >= leaves
                    continue
                length, enters, leaves = _crossing(ends[i], boxes[b])
                if length > leaves + margin_m:
                    passed[b] += 1
                elif length >= enters - margin_m:
                    stopped[b] += 1


@compiled
def _crossing(end: Float32Array, box: FloatArray) -> tuple[float, float, float]:
    """Return a ray's length, and where on it a box begins and ends; no way through: the reverse."""
    length = np.sqrt(end[0] * end[0] + end[1] * end[1] + end[2] * end[2])
    c, s = np.cos(box[6]), np.sin(box[6])
    enters, leaves = 0.0, np.inf
    for axis in range(3):
        if axis == 0:
            middle, way, side = box[0] * c - box[2] * s, end[0] * c - end[2] * s, box[3]
        elif axis == 1:
            middle, way, side = box[0] * s + box[2] * c, end[0] * s + end[2] * c, box[4]
        else:
            middle, way, side = box[1], end[1] * 1.0, box[5]
        slope = way / max(length, 1e-9)
        if abs(slope) < 1e-9:
            if abs(middle) > side / 2:
                return length, 0.0, -1.0
            continue
        one, other = (middle - side / 2) / slope, (middle + side / 2) / slope
        enters = max(enters, min(one, other))
        leaves = min(leaves, max(one, other))
    return length, enters, leaves
