"""The box of a standing object, from the points of all its frames laid over one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.geometry.boxes import box_coordinates, half_turn, l_shape_box
from tcrdata.types import Float32Array, FloatArray


@dataclass(frozen=True)
class FitSettings:
    """How a box is fitted; metres are multiplied by the metric scale.

    Attributes:
        voxel_m: side of the cubes that keep one point each.
        reach_m: points this far outside of the detections' mean box are collected.
        grow_m: points this far outside of the box may be the object's; the box grows with them.
        passes: fits, each with the points of the box before.
        base_m: lower points above the ground are left out: kerbs and grass.
        trim_share: share of the points beyond each side: mirrors, aerials.
        least_points: with fewer the detections' mean box stays.
        turn_rad: the points' outline turns the heading by at most so much.
        least_share: a side seen from both ends is at least this share of what was detected.
        longest_share: the length is at most this share of what was detected.
        widest_share: and the width at most this: walls and hedges stand along a car's side.
    """

    voxel_m: float = 0.1
    reach_m: float = 1.2
    grow_m: float = 0.5
    passes: int = 4
    base_m: float = 0.3
    trim_share: float = 0.02
    least_points: int = 30
    turn_rad: float = 0.2
    least_share: float = 0.8
    longest_share: float = 1.5
    widest_share: float = 1.25


def fitted(
    box: FloatArray, points: Float32Array, sensors: FloatArray, settings: FitSettings
) -> FloatArray:
    """Return a (7,) box anchored on the sides that the sensor saw.

    Along each axis: a side that the sensor passed by at both ends reaches from the first point to
    the last; of one seen from one end alone, that end is where its points end, and it is as long
    as was detected; one seen from neither end stays.

    Args:
        box: (7,) mean of the detections, world.
        points: (N, 4) world x, y, z and height above the ground, thinned.
        sensors: (M, 2) x and z of the sensor in its frames.
        settings: scaled to the world.
    """
    limits = box[3:5].copy()
    for _ in range(settings.passes):
        local = np.abs(box_coordinates(points[:, [0, 2]], box))
        own = points[(local <= box[3:5] / 2 + settings.grow_m).all(axis=1)]
        if len(own) < settings.least_points:
            break
        box = _fitted_once(box, limits, own, sensors, settings)
    return box


def _fitted_once(
    box: FloatArray,
    detected: FloatArray,
    points: Float32Array,
    sensors: FloatArray,
    settings: FitSettings,
) -> FloatArray:
    """Return the box anchored on its points; `detected` is the length and width detected."""
    xz = points[:, [0, 2]].astype(np.float64)
    box = box.copy()
    box[6] = _turned(box[6], xz, settings)
    local, eyes = box_coordinates(xz, box), box_coordinates(sensors, box)
    shift = np.zeros(2)
    for axis in (0, 1):
        low, high = np.quantile(local[:, axis], [settings.trim_share, 1 - settings.trim_share])
        smallest = settings.least_share * detected[axis]
        largest = (settings.longest_share, settings.widest_share)[axis] * detected[axis]
        sizes = (smallest, detected[axis], largest)
        shift[axis], box[3 + axis] = _span(low, high, eyes[:, axis], sizes)
    c, s = np.cos(box[6]), np.sin(box[6])
    box[0] += c * shift[0] + s * shift[1]
    box[2] += -s * shift[0] + c * shift[1]
    ground = float(np.median(points[:, 1] + points[:, 3]))
    top = float(np.quantile(points[:, 3], 1 - settings.trim_share))
    box[1], box[5] = ground - top / 2, top
    return box


def _turned(yaw: float, xz: FloatArray, settings: FitSettings) -> float:
    """Return the heading of the points' outline, where it is near the detected one."""
    outline = l_shape_box(xz, settings.voxel_m / 2).yaw_rad
    turns = [half_turn(outline + quarter - yaw) for quarter in (0.0, np.pi / 2)]
    turn = min(turns, key=abs)
    return yaw + turn if abs(turn) <= settings.turn_rad else yaw


def _span(
    low: float, high: float, eyes: FloatArray, sizes: tuple[float, float, float]
) -> tuple[float, float]:
    """Return the middle and the size along one axis.

    Args:
        low: where the points begin, from the box's middle.
        high: where they end.
        eyes: (M,) the sensor, from the box's middle.
        sizes: the smallest, the detected and the largest size.
    """
    seen_low, seen_high = bool((eyes < low).any()), bool((eyes > high).any())
    smallest, detected, largest = sizes
    if seen_low and seen_high:
        return (low + high) / 2, float(np.clip(high - low, smallest, largest))
    size = float(np.clip(high - low, detected, largest))
    if seen_low:
        return low + size / 2, size
    if seen_high:
        return high - size / 2, size
    return 0.0, size
