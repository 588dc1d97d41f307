"""How much of a box's outline the sensor could not have seen: something nearer is in front."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.range_images import RangeGrid, RangeImage, locate
from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, FloatArray, IntArray

_ALONG = (np.arange(12) + 0.5) / 12
_UP = (np.arange(4) + 0.5) / 4
# The corners as `geometry.boxes` numbers them: in lengths and widths from the centre.
_LENGTHS = np.array([0.5, 0.5, -0.5, -0.5])
_WIDTHS = np.array([0.5, -0.5, -0.5, 0.5])


@compiled
def facing_outline(box: FloatArray, sensor: FloatArray) -> FloatArray:
    """Return (N, 3) level points spread over the sides of a (7,) box that face the sensor.

    Args:
        box: level frame.
        sensor: (3,) its place, level frame. Inside the box, no side faces it.
    """
    c, s = math.cos(box[6]), math.sin(box[6])
    points = np.empty((4 * len(_UP) * len(_ALONG), 3))
    count = 0
    for side in range(4):
        corner, other = side, (side + 1) % 4
        x0 = box[0] + c * (_LENGTHS[corner] * box[3]) + s * (_WIDTHS[corner] * box[4])
        z0 = box[2] - s * (_LENGTHS[corner] * box[3]) + c * (_WIDTHS[corner] * box[4])
        x1 = box[0] + c * (_LENGTHS[other] * box[3]) + s * (_WIDTHS[other] * box[4])
        z1 = box[2] - s * (_LENGTHS[other] * box[3]) + c * (_WIDTHS[other] * box[4])
        # Outward: along, across to the low side, and both the other way.
        outward_x = (c, -s, -c, s)[side]
        outward_z = (-s, -c, s, c)[side]
        away_x, away_z = sensor[0] - (x0 + x1) / 2, sensor[2] - (z0 + z1) / 2
        if outward_x * away_x + outward_z * away_z <= 0:
            continue
        for up in _UP:
            for along in _ALONG:
                points[count, 0] = x0 + along * (x1 - x0)
                points[count, 1] = box[1] + (up - 0.5) * box[5]
                points[count, 2] = z0 + along * (z1 - z0)
                count += 1
    return points[:count]


@compiled
def _count_hidden(
    boxes: FloatArray,
    sensor_T_level: FloatArray,
    sensor: FloatArray,
    nearest: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margin_m: float,
) -> tuple[IntArray, IntArray]:
    """Return how much of the outline of each box the grid has in view, and how much is hidden."""
    T = sensor_T_level
    rows, columns = nearest.shape[0] - 2, nearest.shape[1] - 2
    seen = np.zeros(len(boxes), np.int64)
    hidden = np.zeros(len(boxes), np.int64)
    for i in range(len(boxes)):
        for x, y, z in facing_outline(boxes[i], sensor):
            row, column, distance = locate(
                np.float32(T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]),
                np.float32(T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]),
                np.float32(T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]),
                spherical,
                rows,
                columns,
                numbers,
            )
            if row > 0:
                seen[i] += 1
                hidden[i] += nearest[row, column] < distance - margin_m
    return seen, hidden


def occluded_columns(
    boxes: NDArray[np.floating], grid: RangeGrid, image: RangeImage, margin_m: float
) -> dict[str, list[float | None]]:
    """Return the share of each box's visible outline with a nearer return in front.

    Args:
        boxes: (N, 7), level frame.
        grid: directions of the sensor.
        image: nearest returns of the frame.
        margin_m: a return this much nearer hides what is behind.

    Returns:
        The column occluded_share; None where no part of the outline is in the sensor's view.
    """
    T = grid.sensor_T_level.astype(np.float64)
    seen, hidden = _count_hidden(
        np.ascontiguousarray(boxes, dtype=np.float64).reshape(-1, 7),
        T,
        -T[:, :3].T @ T[:, 3],
        image.nearest_m,
        grid.spherical,
        grid.numbers,
        margin_m,
    )
    pairs = zip(seen.tolist(), hidden.tolist(), strict=True)
    return {"occluded_share": [share / whole if whole else None for whole, share in pairs]}
