"""Columns that every source of proposals fills in the same way.

Each function takes the N boxes (or regions) of one frame and returns whole columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import box_corners_bev, edge_distance
from tcrdata.types import FloatArray, Frame, ImageArray, IntArray

Columns = dict[str, list[Any]]

_NEAR_PLANE_M = 0.1
_EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)


def merged(*parts: Columns) -> Columns:
    """Return the columns of all parts side by side."""
    return {name: values for part in parts for name, values in part.items()}


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
    names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
    columns: Columns = {name: boxes[:, i].tolist() for i, name in enumerate(names)}
    sensor = frame.sensor_matrix[:3, 3]
    columns["range_m"] = np.hypot(boxes[:, 0] - sensor[0], boxes[:, 2] - sensor[2]).tolist()
    projections = [_projection(box, frame) for box in boxes]
    for name in _PROJECTED:
        columns[name] = [p.get(name) for p in projections]
    return columns


_PROJECTED = (
    "left_px",
    "top_px",
    "right_px",
    "bottom_px",
    "center_u_px",
    "center_v_px",
    "truncated_share",
)


def box_corners(box: NDArray[np.floating]) -> FloatArray:
    """Return the (8, 3) corners of a (7,) box: four at the top, then four at the bottom."""
    xz = box_corners_bev(box[None])[0]
    result = np.empty((8, 3))
    result[:, [0, 2]] = np.vstack([xz, xz])
    result[:4, 1] = box[1] - box[5] / 2
    result[4:, 1] = box[1] + box[5] / 2
    return result


def _projection(box: FloatArray, frame: Frame) -> dict[str, float]:
    """Return the 2D columns of one box; without a camera, or behind it, none."""
    matrix = frame.level_projection
    if matrix is None or frame.camera is None:
        return {}
    center = matrix[:, :3] @ box[:3] + matrix[:, 3]
    if center[2] <= _NEAR_PLANE_M:
        return {}
    outline = _visible_outline(box_corners(box) @ matrix[:, :3].T + matrix[:, 3])
    low, high = outline.min(axis=0), outline.max(axis=0)
    size = np.array([frame.camera.width_px, frame.camera.height_px], dtype=np.float64)
    left_top, right_bottom = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
    inside = float(np.prod(right_bottom - left_top))
    result = {
        "center_u_px": float(center[0] / center[2]),
        "center_v_px": float(center[1] / center[2]),
        "truncated_share": 1.0 - inside / max(float(np.prod(high - low)), 1e-9),
    }
    if inside > 0:
        result |= {
            "left_px": float(left_top[0]),
            "top_px": float(left_top[1]),
            "right_px": float(right_bottom[0]),
            "bottom_px": float(right_bottom[1]),
        }
    return result


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
    columns: Columns = {
        name: []
        for name in (
            "core_points",
            "core_share",
            "votes_free_mean",
            "votes_static_mean",
            "free_share",
        )
    }
    for m in members:
        free, static = votes_free[m].astype(np.float64), votes_static[m].astype(np.float64)
        # The definition of the column core_points; what share is enough is for rules to say.
        core = (free >= 2) & (free > static)
        columns["core_points"].append(int(core.sum()))
        columns["core_share"].append(float(core.mean()) if len(m) else None)
        columns["votes_free_mean"].append(float(free.mean()) if len(m) else None)
        columns["votes_static_mean"].append(float(static.mean()) if len(m) else None)
        columns["free_share"].append(float((free > static).mean()) if len(m) else None)
    return columns


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
    gaps = [edge_distance(xz, box) for xz, box in zip(points_xz, boxes, strict=True)]
    return {
        "edge_share": [float((g <= edge_margin_m).mean()) if len(g) else None for g in gaps],
        "fit_residual_m": [float(g.mean()) if len(g) else None for g in gaps],
    }
