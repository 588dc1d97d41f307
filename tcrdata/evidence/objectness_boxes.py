"""A detector's boxes as rows of `proposals`, and its heat as confidences of other boxes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    key_columns,
    merged,
    outline_columns,
    point_columns,
    vote_columns,
)
from tcrdata.evidence.range_images import LidarCells, range_image, sensor_grid
from tcrdata.geometry.boxes import box_coordinates, points_in_box
from tcrdata.networks.grids import Region
from tcrdata.types import Float32Array, FloatArray, Frame, Sensor

SOURCE, FIT = "detector", "center_net"
EDGE_MARGIN_M = 0.3
_GROUND_REACH_M = 4.0
_GROW_M = 0.1


def on_the_ground(
    boxes: FloatArray, xyz: NDArray[np.floating], height_m: NDArray[np.floating]
) -> FloatArray:
    """Return (N, 7) boxes whose y, where it is NaN, is such that they stand on the ground.

    Args:
        boxes: (N, 7).
        xyz: (M, 3) points of the frame.
        height_m: (M,) above the ground; NaN where unknown.
    """
    boxes = boxes.copy()
    known = np.isfinite(height_m)
    level = xyz[known, 1] + height_m[known]
    places = xyz[known][:, [0, 2]]
    everywhere = float(np.median(level)) if len(level) else 0.0
    for number in np.flatnonzero(np.isnan(boxes[:, 1])):
        off = np.abs(places - boxes[number, [0, 2]])
        near = np.maximum(off[:, 0], off[:, 1]) <= _GROUND_REACH_M
        floor = float(np.median(level[near])) if near.any() else everywhere
        boxes[number, 1] = floor - boxes[number, 5] / 2
    return boxes


def footprint_heat(
    heat: NDArray[np.floating], boxes: FloatArray, region: Region
) -> list[float | None]:
    """Return the largest heat of the cells in each box's footprint; None outside of the region.

    Args:
        heat: (rows, columns) probabilities.
        boxes: (N, 7), metres of a road scene.
        region: the ground covered, in the cells of `heat`.
    """
    x, z = region.centers()
    grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    flat = heat.ravel()
    own, inside = region.cells(boxes[:, 0], boxes[:, 2])
    values: list[float | None] = []
    for box, cell, covered in zip(boxes, own, inside, strict=True):
        if not covered:
            values.append(None)
            continue
        along = np.abs(box_coordinates(grid, box))
        within = (along[:, 0] <= box[3] / 2) & (along[:, 1] <= box[4] / 2)
        values.append(float(max(flat[within].max(initial=0.0), flat[cell])))
    return values


def detected_columns(
    boxes: FloatArray,
    frame: Frame,
    sensor: Sensor,
    xyz: Float32Array,
    evidence: Mapping[str, Any],
    front_m: float,
    metric_scale: float,
    round: int,
) -> Columns:
    """Return rows of `proposals` for a frame's detections, surest first.

    Args:
        boxes: (N, 7), level frame, metres.
        frame: where they were seen.
        sensor: lidar or depth.
        xyz: (M, 3) all points of the frame.
        evidence: ground, height_m, votes_free and votes_static, (M,) each.
        front_m: a return this much nearer hides a box's outline; times the metric scale.
        metric_scale: of the sequence.
        round: EM round.
    """
    solid = np.flatnonzero(~evidence["ground"])
    inside = [solid[points_in_box(xyz[solid], box, _GROW_M * metric_scale)] for box in boxes]
    grid = sensor_grid(frame, sensor, LidarCells())
    image = range_image(xyz, grid)
    return merged(
        key_columns(frame, SOURCE, FIT, range(len(boxes)), metric_scale, round),
        box_columns(boxes, frame),
        point_columns(inside, evidence["height_m"]),
        vote_columns(inside, evidence["votes_free"], evidence["votes_static"]),
        outline_columns(boxes, [xyz[m][:, [0, 2]] for m in inside], EDGE_MARGIN_M * metric_scale),
        occluded_columns(boxes, grid, image, front_m * metric_scale),
    )
