"""Columns that every source of proposals fills in the same way.

Each function takes the N boxes (or regions) of one frame and returns whole columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import BOX_COLUMNS, FloatArray, Frame, ImageArray, IntArray

Columns = dict[str, list[Any]]

_NEAR_PLANE_M = 0.1
_EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)


def merged(*parts: Columns) -> Columns:
    """Return the columns of all parts side by side."""
    return {name: values for part in parts for name, values in part.items()}


def stacked(parts: Sequence[Columns]) -> Columns:
    """Return the rows of some parts, at least one, one after the other; all have the same columns.

    A store takes a few long batches in less time than many short ones.
    """
    return {name: [value for part in parts for value in part[name]] for name in parts[0]}


def key_columns(
    frame: Frame,
    source: str,
    fit: str,
    numbers: Sequence[int],
    metric_scale: float,
    round: int = 1,
) -> Columns:
    """Return the ids and what else all proposals of one source and fit share in a frame.

    Args:
        frame: where they were seen.
        source: paper, release, free_space, track or static.
        fit: min_area, l_shape or track.
        numbers: number of each region in its frame and source.
        metric_scale: of the sequence.
        round: EM round; what a later one finds has ids of its own.
    """
    base = f"{frame.dataset}/{frame.sequence}/{frame.frame:06d}/{of_round(source, round)}"
    count = len(numbers)
    return {
        "proposal_id": [f"{base}/{n:03d}/{fit}" for n in numbers],
        "region_id": [f"{base}/{n:03d}" for n in numbers],
        "frame": [frame.frame] * count,
        "source": [source] * count,
        "fit": [fit] * count,
        "found": ["observed"] * count,
        "metric_scale": [metric_scale] * count,
    }


def of_round(source: str, round: int) -> str:
    """Return a source's name in ids: two rounds' third detection are not one object."""
    return source if round == 1 else f"{source}.r{round}"


def box_columns(boxes: NDArray[np.floating], frame: Frame) -> Columns:
    """Return the 3D boxes, their range, and their 2D boxes with truncation.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw in the level frame.
        frame: gives the sensor's place and the camera.
    """
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    columns: Columns = {name: boxes[:, i].tolist() for i, name in enumerate(BOX_COLUMNS)}
    sensor = frame.sensor_matrix[:3, 3]
    columns["range_m"] = np.hypot(boxes[:, 0] - sensor[0], boxes[:, 2] - sensor[2]).tolist()
    return columns | _projections(boxes, frame)


_PROJECTED = (
    "left_px",
    "top_px",
    "right_px",
    "bottom_px",
    "center_u_px",
    "center_v_px",
    "truncated_share",
)


def box_corners(boxes: NDArray[np.floating]) -> FloatArray:
    """Return the (N, 8, 3) corners of (N, 7) boxes: four at the top, then four at the bottom."""
    xz = box_corners_bev(boxes)
    result = np.empty((len(xz), 8, 3))
    result[:, :4, [0, 2]] = result[:, 4:, [0, 2]] = xz
    result[:, :4, 1] = (boxes[:, 1] - boxes[:, 5] / 2)[:, None]
    result[:, 4:, 1] = (boxes[:, 1] + boxes[:, 5] / 2)[:, None]
    return result


def _projections(boxes: FloatArray, frame: Frame) -> Columns:
    """Return the 2D columns of N boxes; None without a camera, or where a box is behind it."""
    matrix = frame.level_projection
    if matrix is None or frame.camera is None or not len(boxes):
        return {name: [None] * len(boxes) for name in _PROJECTED}
    center = np.matmul(matrix[:, :3], boxes[:, :3, None])[:, :, 0] + matrix[:, 3]
    ahead = center[:, 2] > _NEAR_PLANE_M
    outline = box_corners(boxes[ahead]) @ matrix[:, :3].T + matrix[:, 3]
    values = np.full((len(boxes), len(_PROJECTED)), np.nan)
    values[ahead, 4:6] = center[ahead, :2] / center[ahead, 2:]
    size = np.array([frame.camera.width_px, frame.camera.height_px], dtype=np.float64)
    low, high = _spans(outline)
    left_top, right_bottom = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
    inside = np.prod(right_bottom - left_top, axis=1)
    values[ahead, 6] = 1.0 - inside / np.maximum(np.prod(high - low, axis=1), 1e-9)
    values[ahead, :4] = np.where(
        inside[:, None] > 0, np.concatenate([left_top, right_bottom], axis=1), np.nan
    )
    columns = zip(_PROJECTED, values.T.tolist(), strict=True)
    return {name: [None if v != v else v for v in column] for name, column in columns}


def _spans(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest (N, 2) pixels of (N, 8, 3) homogeneous corners.

    Boxes are cut at the plane near the camera.
    """
    cut = np.asarray((corners[:, :, 2] <= _NEAR_PLANE_M).any(axis=1))
    depths = np.where(cut[:, None, None], 1.0, corners[:, :, 2:])
    pixels = corners[:, :, :2] / depths
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    for i in np.flatnonzero(cut):
        visible = _visible_outline(corners[i])
        low[i], high[i] = visible.min(axis=0), visible.max(axis=0)
    return low, high


def _visible_outline(corners: FloatArray) -> FloatArray:
    """Return pixels that span (8, 3) homogeneous corners, cut at the plane near the camera."""
    depths = corners[:, 2]
    kept = [corners[depths > _NEAR_PLANE_M]]
    for a, b in _EDGES:
        if (depths[a] > _NEAR_PLANE_M) != (depths[b] > _NEAR_PLANE_M):
            share = (_NEAR_PLANE_M - depths[a]) / (depths[b] - depths[a])
            kept.append((corners[a] + share * (corners[b] - corners[a]))[None])
    visible = np.concatenate(kept)
    pixels: FloatArray = visible[:, :2] / visible[:, 2:3]
    return pixels


def point_columns(members: Sequence[IntArray], heights_m: NDArray[np.floating] | None) -> Columns:
    """Return the columns of the points of N regions.

    Args:
        members: indices into the frame's points, a region each.
        heights_m: (points of the frame,) heights above the ground; None when not measured.
    """
    columns: Columns = {
        "number_of_points": [len(m) for m in members],
        "point_indices": [m.tolist() for m in members],
    }
    if heights_m is not None:
        spans = [_finite_span(heights_m[m]) for m in members]
        columns["bottom_above_ground_m"] = [span[0] for span in spans]
        columns["top_above_ground_m"] = [span[1] for span in spans]
    return columns


def _finite_span(values: NDArray[np.floating]) -> tuple[float | None, float | None]:
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (None, None)


def vote_columns(
    members: Sequence[IntArray], votes_free: ImageArray, votes_static: ImageArray
) -> Columns:
    """Return what the free-space votes (points of the frame,) say of N regions."""
    counts = [len(m) for m in members]
    chosen = np.concatenate([np.empty(0, np.int64), *members])
    free, static = votes_free[chosen], votes_static[chosen]
    # The definition of the column core_points; what share is enough is for rules to say.
    core = (free >= 2) & (free > static)
    core_points = _sums(core, counts)
    return {
        "core_points": core_points,
        "core_share": _shares(core_points, counts),
        "votes_free_mean": _shares(_sums(free, counts), counts),
        "votes_static_mean": _shares(_sums(static, counts), counts),
        "free_share": _shares(_sums(free > static, counts), counts),
    }


def _sums(values: NDArray[Any], counts: list[int]) -> list[int]:
    """Return the sum of each run of whole numbers, given how long the runs are."""
    totals = np.concatenate([[0], np.cumsum(values, dtype=np.int64)])
    ends = np.cumsum([0, *counts])
    sums: list[int] = (totals[ends[1:]] - totals[ends[:-1]]).tolist()
    return sums


def _shares(sums: Sequence[float], counts: list[int]) -> list[float | None]:
    return [float(total) / n if n else None for total, n in zip(sums, counts, strict=True)]


def outline_columns(
    boxes: NDArray[np.floating],
    points_xz: Sequence[NDArray[np.floating]],
    edge_margin_m: float,
) -> Columns:
    """Return how well N boxes' sides, seen from above, hug their points.

    Args:
        boxes: (N, 7).
        points_xz: (M, 2) points (x, z) of each box.
        edge_margin_m: a point this near a side lies on it.
    """
    counts = [len(xz) for xz in points_xz]
    gaps = _edge_gaps(np.asarray(boxes, dtype=np.float64), points_xz, counts)
    sums = [np.add.reduce(g) for g in np.split(gaps, np.cumsum(counts)[:-1])] if counts else []
    return {
        "edge_share": _shares(_sums(gaps <= edge_margin_m, counts), counts),
        "fit_residual_m": _shares(sums, counts),
    }


def _edge_gaps(
    boxes: FloatArray, points_xz: Sequence[NDArray[np.floating]], counts: list[int]
) -> FloatArray:
    """Return how far each point is from its box's nearest side, box after box."""
    xz = np.concatenate([np.empty((0, 2), np.float32), *points_xz])
    turns = [[math.cos(yaw), math.sin(yaw)] for yaw in boxes[:, 6].tolist()]
    poses = np.column_stack([boxes[:, [0, 2]], np.reshape(turns, (-1, 2))]).astype(xz.dtype)
    x, z, c, s = np.repeat(poses, counts, axis=0).T
    dx, dz = xz[:, 0] - x, xz[:, 1] - z
    local = np.abs(np.stack([dx * c - dz * s, dx * s + dz * c], axis=1)).astype(np.float64)
    halves = np.repeat(boxes[:, 3:5] / 2, counts, axis=0)
    return np.asarray(np.abs(halves - local).min(axis=1))
