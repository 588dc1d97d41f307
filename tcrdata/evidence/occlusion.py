"""How much of a box's outline the sensor could not have seen: something nearer is in front."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.kernels import compiled
from tcrdata.evidence.range_images import RangeGrid, RangeImage, locate
from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import Float32Array, FloatArray

_ALONG = (np.arange(12) + 0.5) / 12
_UP = (np.arange(4) + 0.5) / 4


@compiled
def _count_hidden(
    points: Float32Array,
    nearest: Float32Array,
    spherical: bool,
    numbers: Float32Array,
    margin_m: float,
) -> tuple[int, int]:
    """Return how many (N, 3) sensor points are in view of the grid, and how many are hidden."""
    rows, columns = nearest.shape[0] - 2, nearest.shape[1] - 2
    seen, hidden = 0, 0
    for i in range(len(points)):
        x, y, z = points[i]
        row, column, distance = locate(x, y, z, spherical, rows, columns, numbers)
        if row > 0:
            seen += 1
            hidden += nearest[row, column] < distance - margin_m
    return seen, hidden


def facing_outline(box: NDArray[np.floating], sensor: FloatArray) -> FloatArray:
    """Return (N, 3) level points spread over the sides of a (7,) box that face the sensor.

    Args:
        box: level frame.
        sensor: (3,) its place, level frame. Inside the box, no side faces it.
    """
    corners = box_corners_bev(box[None])[0]
    c, s = np.cos(box[6]), np.sin(box[6])
    along, across = np.array([c, -s]), np.array([s, c])
    heights = box[1] + (_UP - 0.5) * box[5]
    sides = []
    for side, outward in enumerate((along, -across, -along, across)):
        start, end = corners[side], corners[(side + 1) % 4]
        if outward @ (sensor[[0, 2]] - (start + end) / 2) > 0:
            xz = start + _ALONG[:, None] * (end - start)
            points = np.empty((len(_UP), len(xz), 3))
            points[:, :, [0, 2]] = xz
            points[:, :, 1] = heights[:, None]
            sides.append(points.reshape(-1, 3))
    return np.concatenate(sides) if sides else np.empty((0, 3))


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
    sensor = -T[:, :3].T @ T[:, 3]
    shares: list[float | None] = []
    for box in np.asarray(boxes, dtype=np.float64).reshape(-1, 7):
        points = facing_outline(box, sensor) @ T[:, :3].T + T[:, 3]
        seen, hidden = _count_hidden(
            points.astype(np.float32), image.nearest_m, grid.spherical, grid.numbers, margin_m
        )
        shares.append(hidden / seen if seen else None)
    return {"occluded_share": shares}
