"""Intersection over union of labels and labelled objects in one frame: from above and in the image.

A box is (x, y, z, length, width, height, yaw) in the level frame; a 2D box (left, top, right,
bottom) in pixels.
"""

from __future__ import annotations

import numpy as np

from tcrdata.geometry.boxes import bev_iou, box_corners_bev
from tcrdata.types import BoolArray, FloatArray

_UPRIGHT = 0.999
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2


def bev_overlap(
    labels: FloatArray,
    truths: FloatArray,
    rotations: FloatArray,
    sizes: FloatArray,
    yaw_observable: BoolArray,
) -> FloatArray:
    """Return (N, M) overlaps of footprints.

    A labelled object whose yaw cannot be observed takes each label's yaw; one that is tilted has
    the convex hull of its eight corners as its footprint.

    Args:
        labels: (N, 7).
        truths: (M, 7).
        rotations: (M, 3, 3) `level_R_object` with columns length, height, width; NaN when unknown.
        sizes: (M, 3) the objects' own extents along those columns; NaN when unknown.
        yaw_observable: (M,).
    """
    overlap = bev_iou(labels, truths)
    if not len(labels) or not len(truths):
        return overlap
    round_ones = np.flatnonzero(~yaw_observable)
    overlap[:, round_ones] = _parallel_iou(labels, truths[round_ones])
    with np.errstate(invalid="ignore"):
        tilted = yaw_observable & (np.abs(rotations[:, 1, 1]) < _UPRIGHT)
    sizes = np.where(np.isfinite(sizes), sizes, truths[:, [3, 5, 4]])
    for column in np.flatnonzero(tilted):
        overlap[:, column] = _hull_iou(labels, truths[column, :3], rotations[column], sizes[column])
    return overlap


def image_overlap(labels: FloatArray, truths: FloatArray) -> FloatArray:
    """Return (N, M) overlaps of (N, 4) and (M, 4) boxes in pixels; 0 where a box is NaN."""
    shared, area_labels, area_truths = _shared_area(labels, truths)
    union = area_labels[:, None] + area_truths[None, :] - shared
    return _ratio(shared, union)


def covered_share(labels: FloatArray, regions: FloatArray) -> FloatArray:
    """Return (N,) the largest share of each (N, 4) box that one of (M, 4) regions covers."""
    if not len(regions):
        return np.zeros(len(labels))
    shared, area_labels, _ = _shared_area(labels, regions)
    return np.asarray(_ratio(shared, np.repeat(area_labels[:, None], len(regions), 1)).max(axis=1))


def _parallel_iou(labels: FloatArray, truths: FloatArray) -> FloatArray:
    """Overlap of rectangles when each truth is turned to each label's yaw."""
    c, s = np.cos(labels[:, None, 6]), np.sin(labels[:, None, 6])
    dx = truths[None, :, 0] - labels[:, None, 0]
    dz = truths[None, :, 2] - labels[:, None, 2]
    shared = np.ones_like(dx)
    for offset, size in ((dx * c - dz * s, 3), (dx * s + dz * c, 4)):
        half_a, half_b = labels[:, None, size] / 2, truths[None, :, size] / 2
        end = np.minimum(half_a, offset + half_b)
        shared *= np.maximum(end - np.maximum(-half_a, offset - half_b), 0)
    area_labels, area_truths = labels[:, 3] * labels[:, 4], truths[:, 3] * truths[:, 4]
    return _ratio(shared, area_labels[:, None] + area_truths[None, :] - shared)


def _hull_iou(
    labels: FloatArray, center: FloatArray, rotation: FloatArray, size: FloatArray
) -> FloatArray:
    """Overlap of (N, 7) footprints with the shadow, straight down, of one tilted box."""
    import shapely

    corners = (_CORNERS * size) @ rotation.T + center
    shadow = shapely.convex_hull(shapely.multipoints(corners[:, [0, 2]]))
    footprints = shapely.polygons(box_corners_bev(labels))
    shared = np.asarray(shapely.area(shapely.intersection(footprints, shadow)))
    return _ratio(shared, labels[:, 3] * labels[:, 4] + shapely.area(shadow) - shared)


def _shared_area(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=2)
    area_a, area_b = (np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (a, b))
    return np.nan_to_num(shared), np.nan_to_num(area_a), np.nan_to_num(area_b)


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    positive = denominator > 0
    return np.where(positive, numerator / np.where(positive, denominator, 1.0), 0.0)
