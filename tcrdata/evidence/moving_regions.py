"""Rows that the motion cues' regions share: boxes, outlines, and what motion says of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.moving_points import MovingPoints
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    key_columns,
    merged,
    outline_columns,
    point_columns,
)
from tcrdata.geometry.boxes import BevBox, l_shape_box, min_area_box
from tcrdata.geometry.hulls import hull_pixels
from tcrdata.store.arrays import encode_mask
from tcrdata.types import Float32Array, FloatArray, IntArray, Rows

EDGE_MARGIN_M = 0.3  # the definition of the column edge_share
_FITS: dict[str, Callable[[NDArray[np.floating]], BevBox]] = {
    "min_area": min_area_box,
    "l_shape": l_shape_box,
}


@dataclass(frozen=True)
class Confidence:
    """How motion becomes a confidence: `1 - exp(-lambda x)`, with lambda by its half-way point.

    Attributes:
        half_3d_m: |dXYZ| of confidence 1/2, times the metric scale. The default is the
            egomotion's inlier radius, the most that the static world is allowed to move: a region
            at that bound is an even bet, and lambda = ln 2 / 0.25 m = 2.8 / m.
        half_2d_px: |flow - egomotion flow| of confidence 1/2. The default is what the released
            code asks of a motion component in its later rounds: lambda = ln 2 / 2 px = 0.35 / px.
    """

    half_3d_m: float = 0.25
    half_2d_px: float = 2.0


@dataclass(frozen=True)
class Region:
    """A region of one frame.

    Attributes:
        members: (K,) places in the frame's moving points, rising.
        measured: columns of `proposals` that its source alone measures.
    """

    members: IntArray
    measured: Mapping[str, Any]


def region_rows(
    points: MovingPoints,
    source: str,
    regions: Sequence[Region],
    fits: Sequence[str],
    confidence: Confidence,
) -> Iterator[Rows]:
    """Yield the `proposals` and `confidences` of a frame's regions, one proposal a fit.

    Args:
        points: of the frame.
        source: of the proposals.
        regions: numbered from 0 in this order; all measure the same columns.
        fits: min_area, l_shape.
        confidence: how motion becomes a confidence.
    """
    if not regions:
        return
    members = [points.indices[region.members] for region in regions]
    shared = merged(
        point_columns(members, points.heights_m),
        {"mask": [_mask(points, region.members) for region in regions]},
        _columns([motion_medians(points, region.members) for region in regions]),
        _columns([region.measured for region in regions]),
    )
    for fit in fits:
        columns = merged(shared, _fitted(points, source, regions, fit))
        yield Rows("proposals", columns)
        yield Rows("confidences", confidence_columns(columns, points.metric_scale, confidence))


def box_around(xyz: NDArray[np.floating], fit: str) -> tuple[FloatArray, float]:
    """Return the (7,) box around (K, 3) level points and its fill share; height = y extent."""
    bev = _FITS[fit](xyz[:, [0, 2]])
    top, bottom = float(xyz[:, 1].min()), float(xyz[:, 1].max())
    box = np.array(
        [bev.cx, (top + bottom) / 2, bev.cz, bev.length, bev.width, bottom - top, bev.yaw_rad]
    )
    return box, bev.fill_share


def _mask(points: MovingPoints, members: IntArray) -> str:
    return encode_mask(hull_pixels(points.pixels[members], *points.size_px))


def motion_medians(points: MovingPoints, members: IntArray) -> dict[str, float | None]:
    """Return the medians of the motion of a region's points; None where none has it."""
    return {
        "motion_3d_m": _median(points.motion_3d_m[members]),
        "motion_2d_px": _median(points.motion_2d_px[members]),
        "motion_cosine": _median(points.cosine[members]),
    }


def confidence_columns(proposals: Columns, metric_scale: float, confidence: Confidence) -> Columns:
    """Return what the modules motion_3d and motion_2d say of proposals, NULL without motion."""
    half_m = confidence.half_3d_m * metric_scale
    modules = (
        ("motion_3d", "motion_3d_m", half_m, "m"),
        ("motion_2d", "motion_2d_px", confidence.half_2d_px, "px"),
    )
    parts: list[dict[str, Any]] = [
        {
            "proposal_id": name,
            "frame": frame,
            "source": source,
            "module": module,
            "confidence": None if value is None else confidence_of(value, half),
            "raw_value": value,
            "unit": unit,
        }
        for module, column, half, unit in modules
        for name, frame, source, value in zip(
            *(proposals[key] for key in ("proposal_id", "frame", "source", column)), strict=True
        )
    ]
    return _columns(parts)


def confidence_of(value: float, half: float) -> float:
    """Return `1 - exp(-ln 2 value / half)`: 0 without motion, 1/2 at `half`, towards 1 above."""
    return -math.expm1(-math.log(2.0) * value / half)


def _fitted(points: MovingPoints, source: str, regions: Sequence[Region], fit: str) -> Columns:
    clouds = [points.xyz[region.members] for region in regions]
    boxes, fills = zip(*(box_around(xyz, fit) for xyz in clouds), strict=True)
    stacked = np.stack(boxes)
    margin_m = EDGE_MARGIN_M * points.metric_scale
    return merged(
        key_columns(points.frame, source, fit, range(len(regions)), points.metric_scale),
        box_columns(stacked, points.frame),
        {"fill_share": list(fills)},
        outline_columns(stacked, [xyz[:, [0, 2]] for xyz in clouds], margin_m),
    )


def _columns(rows: Sequence[Mapping[str, Any]]) -> Columns:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _median(values: Float32Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
