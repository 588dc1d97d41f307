"""Boxes seen from above: fitting them to points, their corners, members and overlaps.

Points are (N, 2) columns (x, z) of the level frame. A box is (x, y, z, length, width, height, yaw);
its length runs along (cos yaw, -sin yaw) and its width along (sin yaw, cos yaw) in (x, z).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, FloatArray

_ANGLES = 90
_CORNER_SIGNS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])


class BevBox(NamedTuple):
    """A rectangle seen from above.

    Attributes:
        cx: centre, metres.
        cz: centre, metres.
        length: longer side, metres.
        width: shorter side, metres.
        yaw_rad: direction of the length, in (-pi/2, pi/2]: a rectangle has no front.
        fill_share: area of the points' convex hull over the rectangle's; 0 for a flat rectangle.
    """

    cx: float
    cz: float
    length: float
    width: float
    yaw_rad: float
    fill_share: float


@compiled
def _convex_hull(points: FloatArray) -> FloatArray:
    """Return the hull's corners in order, of points sorted by x, then z (monotone chain)."""
    count = len(points)
    hull = np.empty((2 * count + 1, 2))
    size = 0
    for sweep in range(2):
        start = size
        for i in range(count):
            p = points[i if sweep == 0 else count - 1 - i]
            while size >= start + 2:
                ax = hull[size - 1, 0] - hull[size - 2, 0]
                az = hull[size - 1, 1] - hull[size - 2, 1]
                bx = p[0] - hull[size - 2, 0]
                bz = p[1] - hull[size - 2, 1]
                if ax * bz - az * bx > 0:
                    break
                size -= 1
            hull[size, 0] = p[0]
            hull[size, 1] = p[1]
            size += 1
        if size > start:
            size -= 1
    return hull[: max(size, 1)].copy()


@compiled
def _polygon_area(corners: FloatArray) -> float:
    total = 0.0
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        total += corners[i, 0] * corners[j, 1] - corners[j, 0] * corners[i, 1]
    return abs(total) / 2


@compiled
def _extents(points: FloatArray, angle: float) -> tuple[float, float, float, float]:
    """Return the smallest and largest coordinates along the length and width axes."""
    c, s = math.cos(angle), math.sin(angle)
    l0, l1, w0, w1 = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(points)):
        along = points[i, 0] * c - points[i, 1] * s
        across = points[i, 0] * s + points[i, 1] * c
        l0, l1 = min(l0, along), max(l1, along)
        w0, w1 = min(w0, across), max(w1, across)
    return l0, l1, w0, w1


@compiled
def _smallest_rectangle_angle(hull: FloatArray) -> float:
    best_angle, best_area = 0.0, np.inf
    for i in range(len(hull)):
        j = (i + 1) % len(hull)
        angle = -math.atan2(hull[j, 1] - hull[i, 1], hull[j, 0] - hull[i, 0])
        l0, l1, w0, w1 = _extents(hull, angle)
        area = (l1 - l0) * (w1 - w0)
        if area < best_area - 1e-12:
            best_angle, best_area = angle, area
    return best_angle


@compiled
def _closeness_angle(points: FloatArray, floor_m: float) -> float:
    best_angle, best_score = 0.0, -1.0
    for step in range(_ANGLES):
        angle = step * (math.pi / 2) / _ANGLES
        l0, l1, w0, w1 = _extents(points, angle)
        c, s = math.cos(angle), math.sin(angle)
        score = 0.0
        for i in range(len(points)):
            along = points[i, 0] * c - points[i, 1] * s
            across = points[i, 0] * s + points[i, 1] * c
            gap = min(min(along - l0, l1 - along), min(across - w0, w1 - across))
            score += 1.0 / max(gap, floor_m)
        if score > best_score + 1e-9:
            best_angle, best_score = angle, score
    return best_angle


def _sorted(xz: NDArray[np.floating]) -> FloatArray:
    points = np.asarray(xz, dtype=np.float64)
    return np.ascontiguousarray(points[np.lexsort((points[:, 1], points[:, 0]))])


def _rectangle(points: FloatArray, hull: FloatArray, angle: float) -> BevBox:
    """Return the rectangle around the points at an angle, length along the longer side."""
    l0, l1, w0, w1 = _extents(points, angle)
    along, across = (l0 + l1) / 2, (w0 + w1) / 2
    c, s = math.cos(angle), math.sin(angle)
    length, width, yaw = l1 - l0, w1 - w0, angle
    if width > length:
        length, width, yaw = width, length, angle - math.pi / 2
    area = length * width
    fill = min(_polygon_area(hull) / area, 1.0) if area > 0 else 0.0
    center_x, center_z = c * along + s * across, -s * along + c * across
    return BevBox(center_x, center_z, length, width, half_turn(yaw), fill)


def half_turn(yaw_rad: float) -> float:
    """Return the same axis with its yaw in (-pi/2, pi/2]."""
    return math.pi / 2 - (math.pi / 2 - yaw_rad) % math.pi


def min_area_box(xz: NDArray[np.floating]) -> BevBox:
    """Return the smallest rectangle around (N, 2) points, N >= 1; one side lies on the hull."""
    hull = _convex_hull(_sorted(xz))
    return _rectangle(hull, hull, _smallest_rectangle_angle(hull))


def l_shape_box(xz: NDArray[np.floating], floor_m: float = 0.05) -> BevBox:
    """Return the rectangle whose sides the (N, 2) points hug best, N >= 1.

    Searches one quadrant by whole degrees for the largest `sum 1 / max(distance to the nearest
    side, floor_m)`: the closeness criterion of Zhang et al., "Efficient L-shape fitting for
    vehicle detection using laser scanners" (2017).
    """
    points = _sorted(xz)
    angle = _closeness_angle(points, floor_m)
    return _rectangle(points, _convex_hull(points), angle)


def box_coordinates(xz: NDArray[np.floating], box: NDArray[np.floating]) -> FloatArray:
    """Return (N, 2) coordinates along the length and the width from the centre of a (7,) box."""
    c, s = math.cos(box[6]), math.sin(box[6])
    dx, dz = xz[:, 0] - float(box[0]), xz[:, 1] - float(box[2])
    return np.stack([dx * c - dz * s, dx * s + dz * c], axis=1).astype(np.float64)


def box_corners_bev(boxes: NDArray[np.floating]) -> FloatArray:
    """Return the (N, 4, 2) corners (x, z) of (N, 7) boxes, in order around the box."""
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    along = _CORNER_SIGNS[:, 0] * boxes[:, 3:4] / 2
    across = _CORNER_SIGNS[:, 1] * boxes[:, 4:5] / 2
    c, s = np.cos(boxes[:, 6:7]), np.sin(boxes[:, 6:7])
    x = boxes[:, 0:1] + c * along + s * across
    z = boxes[:, 2:3] - s * along + c * across
    return np.stack([x, z], axis=2)


def points_in_box(
    xyz: NDArray[np.floating], box: NDArray[np.floating], margin_m: float = 0.0
) -> BoolArray:
    """Return which of (N, 3) level points lie in a (7,) box grown by a margin on every side."""
    return _inside(np.ascontiguousarray(xyz), np.asarray(box, dtype=np.float64), margin_m)


@compiled
def _inside(xyz: NDArray[np.floating], box: FloatArray, margin_m: float) -> BoolArray:
    c, s = math.cos(box[6]), math.sin(box[6])
    length, width, height = box[3] / 2 + margin_m, box[4] / 2 + margin_m, box[5] / 2 + margin_m
    reach = math.hypot(length, width)
    result = np.zeros(len(xyz), np.bool_)
    for i in range(len(xyz)):
        dx = xyz[i, 0] - box[0]
        if abs(dx) > reach:
            continue
        dz = xyz[i, 2] - box[2]
        result[i] = (
            abs(dx * c - dz * s) <= length
            and abs(dx * s + dz * c) <= width
            and abs(xyz[i, 1] - box[1]) <= height
        )
    return result


def edge_distance(xz: NDArray[np.floating], box: NDArray[np.floating]) -> FloatArray:
    """Return (N,) distances, from above, of points to the nearest side line of a (7,) box."""
    local = np.abs(box_coordinates(xz, box))
    gaps = np.abs(np.array([box[3] / 2, box[4] / 2], dtype=np.float64) - local)
    return np.asarray(gaps.min(axis=1))


def edge_share(xz: NDArray[np.floating], box: NDArray[np.floating], margin_m: float) -> float:
    """Return the share of (N, 2) points within a margin of a side of the box; 0 without points."""
    return float((edge_distance(xz, box) <= margin_m).mean()) if len(xz) else 0.0


def bev_iou(boxes_a: NDArray[np.floating], boxes_b: NDArray[np.floating]) -> FloatArray:
    """Return the (Na, Nb) intersection over union of the rotated footprints of (N, 7) boxes."""
    boxes_a = np.asarray(boxes_a, dtype=np.float64).reshape(-1, 7)
    boxes_b = np.asarray(boxes_b, dtype=np.float64).reshape(-1, 7)
    result = np.zeros((len(boxes_a), len(boxes_b)))
    reach_a = np.hypot(boxes_a[:, 3], boxes_a[:, 4]) / 2
    reach_b = np.hypot(boxes_b[:, 3], boxes_b[:, 4]) / 2
    gap = np.hypot(
        boxes_a[:, None, 0] - boxes_b[None, :, 0], boxes_a[:, None, 2] - boxes_b[None, :, 2]
    )
    rows, columns = np.nonzero(gap < reach_a[:, None] + reach_b[None, :])
    if not len(rows):
        return result
    polygons_a = shapely.polygons(box_corners_bev(boxes_a))
    polygons_b = shapely.polygons(box_corners_bev(boxes_b))
    shared = shapely.area(shapely.intersection(polygons_a[rows], polygons_b[columns]))
    area_a, area_b = boxes_a[:, 3] * boxes_a[:, 4], boxes_b[:, 3] * boxes_b[:, 4]
    union = area_a[rows] + area_b[columns] - shared
    result[rows, columns] = np.where(union > 0, shared / np.where(union > 0, union, 1.0), 0.0)
    return result
