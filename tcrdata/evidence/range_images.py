"""The nearest return in every direction: what a sensor could see through, and what it could not.

A grid is spherical (LiDAR: azimuth by elevation in the sensor's own frame) or perspective (the
pixels of a depth image). Ranges are Euclidean distances from the sensor in metres; no return is
infinity. Images carry a border of one empty cell, so that 3x3 windows need no bounds; the azimuth
border repeats the other side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import EvidenceError
from tcrdata.geometry.kernels import compiled
from tcrdata.geometry.transforms import inverse
from tcrdata.types import Float32Array, Frame, Sensor

_HALF_PI = np.float32(np.pi / 2)
_PI = np.float32(np.pi)
_TINY = np.float32(1e-20)

# Row, column, range in metres.
Cell = tuple[np.signedinteger[Any], np.signedinteger[Any], np.floating[Any]]


@dataclass(frozen=True)
class LidarCells:
    """The directions that a LiDAR's range image tells apart.

    Attributes:
        azimuth_deg: width of a cell.
        elevation_deg: height of a cell.
        lowest_deg: lowest elevation with a cell.
        highest_deg: highest elevation with a cell.
    """

    azimuth_deg: float = 0.2
    elevation_deg: float = 0.42
    lowest_deg: float = -30.0
    highest_deg: float = 12.0


@dataclass(frozen=True)
class RangeGrid:
    """The directions of one sensor.

    Attributes:
        spherical: azimuth and elevation; else a pinhole image.
        rows: without the border.
        columns: without the border.
        sensor_T_level: (3, 4) float32; spherical: x forward, z up.
        numbers: (4,) float32. Spherical: columns a radian, rows a radian, highest elevation in
            radians, unused. Perspective: fx, fy, cx, cy in pixels.
    """

    spherical: bool
    rows: int
    columns: int
    sensor_T_level: Float32Array
    numbers: Float32Array


@dataclass(frozen=True)
class RangeImage:
    """The nearest returns of one frame.

    Attributes:
        nearest_m: (rows + 2, columns + 2) float32, the nearest return of each cell.
        window_m: the same shape, the nearest return of each cell's 3x3 window.
    """

    nearest_m: Float32Array
    window_m: Float32Array


def spherical_grid(frame: Frame, cells: LidarCells) -> RangeGrid:
    """Return a LiDAR's grid; directions outside the elevations have no cell."""
    columns = max(round(360.0 / cells.azimuth_deg), 1)
    return RangeGrid(
        spherical=True,
        rows=max(round((cells.highest_deg - cells.lowest_deg) / cells.elevation_deg), 1),
        columns=columns,
        sensor_T_level=inverse(frame.sensor_matrix)[:3].astype(np.float32),
        numbers=np.array(
            [
                columns / (2 * np.pi),
                1.0 / np.radians(cells.elevation_deg),
                np.radians(cells.highest_deg),
                0.0,
            ],
            np.float32,
        ),
    )


def perspective_grid(frame: Frame) -> RangeGrid:
    """Return a depth camera's grid: its pixels.

    Raises:
        EvidenceError: the frame has no camera.
    """
    if frame.camera is None:
        raise EvidenceError(
            f"{frame.dataset}/{frame.sequence} frame {frame.frame}: a depth frame has no camera: "
            "its intrinsics must be known"
        )
    matrix = frame.camera.matrix
    return RangeGrid(
        spherical=False,
        rows=frame.camera.height_px,
        columns=frame.camera.width_px,
        sensor_T_level=np.asarray(frame.camera_T_level, dtype=np.float32)[:3],
        numbers=np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], np.float32),
    )


def sensor_grid(frame: Frame, sensor: Sensor, cells: LidarCells) -> RangeGrid:
    """Return the grid of a frame's sensor; the cells are those of LiDAR grids."""
    return perspective_grid(frame) if sensor == "depth" else spherical_grid(frame, cells)


@compiled
def _arctan2(y: np.float32, x: np.float32) -> np.float32:
    """Return the angle in radians, within 2e-5 (a hundredth of a cell), without a branch.

    Polynomial of Abramowitz & Stegun, "Handbook of Mathematical Functions", 4.4.47.
    """
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(max(ax, ay), _TINY)
    s = t * t
    high = np.float32(0.1801410) + s * (np.float32(-0.0851330) + s * np.float32(0.0208351))
    angle = t * (np.float32(0.9998660) + s * (np.float32(-0.3302995) + s * high))
    angle = _HALF_PI - angle if ay > ax else angle
    angle = _PI - angle if x < 0 else angle
    return -angle if y < 0 else angle


@compiled
def _spherical_cell(
    x: np.float32, y: np.float32, z: np.float32, rows: int, columns: int, numbers: Float32Array
) -> Cell:
    flat = x * x + y * y
    elevation = _arctan2(z, np.sqrt(flat))
    row = np.int32(np.floor((numbers[2] - elevation) * numbers[1]))
    column = np.int32((_PI - _arctan2(y, x)) * numbers[0])
    column = np.int32(column - columns) if column >= columns else column
    row = row + np.int32(1) if (row >= 0) & (row < rows) else np.int32(-1)
    return row, column + np.int32(1), np.sqrt(flat + z * z)


@compiled
def _perspective_cell(
    x: np.float32, y: np.float32, z: np.float32, rows: int, columns: int, numbers: Float32Array
) -> Cell:
    ahead = z > _TINY
    depth = z if ahead else np.float32(1.0)
    u = np.floor(numbers[0] * x / depth + numbers[2] + np.float32(0.5))
    v = np.floor(numbers[1] * y / depth + numbers[3] + np.float32(0.5))
    inside = ahead & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    row = np.int32(v) + np.int32(1) if inside else np.int32(-1)
    column = np.int32(u) + np.int32(1) if inside else np.int32(1)
    return row, column, np.sqrt(x * x + y * y + z * z)


@compiled
def locate(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    spherical: bool,
    rows: int,
    columns: int,
    numbers: Float32Array,
) -> Cell:
    """Return the cell (row, column, border counted in) of a sensor point, and its range.

    The row is -1 when the point has no cell.
    """
    if spherical:
        return _spherical_cell(x, y, z, rows, columns, numbers)
    return _perspective_cell(x, y, z, rows, columns, numbers)


@compiled
def _cells_of(
    points: Float32Array,
    T: Float32Array,
    spherical: bool,
    rows: int,
    columns: int,
    numbers: Float32Array,
) -> tuple[NDArray[np.int32], Float32Array]:
    px, py, pz = points[0], points[1], points[2]
    t = T.copy()
    cells = np.empty(px.size, np.int32)
    ranges = np.empty(px.size, np.float32)
    stride = np.int32(columns + 2)
    if spherical:
        for i in range(px.size):
            x = t[0, 0] * px[i] + t[0, 1] * py[i] + t[0, 2] * pz[i] + t[0, 3]
            y = t[1, 0] * px[i] + t[1, 1] * py[i] + t[1, 2] * pz[i] + t[1, 3]
            z = t[2, 0] * px[i] + t[2, 1] * py[i] + t[2, 2] * pz[i] + t[2, 3]
            row, column, ranges[i] = _spherical_cell(x, y, z, rows, columns, numbers)
            cells[i] = row * stride + column if row > 0 else np.int32(0)
    else:
        for i in range(px.size):
            x = t[0, 0] * px[i] + t[0, 1] * py[i] + t[0, 2] * pz[i] + t[0, 3]
            y = t[1, 0] * px[i] + t[1, 1] * py[i] + t[1, 2] * pz[i] + t[1, 3]
            z = t[2, 0] * px[i] + t[2, 1] * py[i] + t[2, 2] * pz[i] + t[2, 3]
            row, column, ranges[i] = _perspective_cell(x, y, z, rows, columns, numbers)
            cells[i] = row * stride + column if row > 0 else np.int32(0)
    return cells, ranges


def cells_of(
    points: Float32Array, sensor_T_points: Float32Array, grid: RangeGrid
) -> tuple[NDArray[np.int32], Float32Array]:
    """Return where a sensor sees points, and how far.

    Args:
        points: (3, N) float32, contiguous: x, y and z of the points.
        sensor_T_points: (3, 4) float32 to the grid's sensor.
        grid: directions of the sensor.

    Returns:
        (N,) cells: indices into the flattened bordered image, 0 (a corner of the border, always
        empty) for points without a cell; and (N,) ranges in metres.
    """
    cells, ranges = _cells_of(
        points, sensor_T_points, grid.spherical, grid.rows, grid.columns, grid.numbers
    )
    return cells, ranges


@compiled
def _nearest(
    cells: NDArray[np.int32], ranges: Float32Array, rows: int, columns: int, spherical: bool
) -> Float32Array:
    image = np.full((rows + 2, columns + 2), np.float32(np.inf), np.float32)
    flat = image.ravel()
    for i in range(cells.size):
        if cells[i] > 0 and ranges[i] < flat[cells[i]]:
            flat[cells[i]] = ranges[i]
    if spherical:
        # Assigning slices would compile numba's text formatting for an error that cannot be.
        for r in range(rows + 2):
            image[r, 0] = image[r, columns]
            image[r, columns + 1] = image[r, 1]
    return image


@compiled
def _window_minimum(image: Float32Array) -> Float32Array:
    rows, columns = image.shape
    across = image.copy()
    for r in range(rows):
        for c in range(1, columns - 1):
            across[r, c] = min(image[r, c - 1], min(image[r, c], image[r, c + 1]))
    result = across.copy()
    for r in range(1, rows - 1):
        for c in range(columns):
            result[r, c] = min(across[r - 1, c], min(across[r, c], across[r + 1, c]))
    return result


def range_image(xyz: NDArray[np.float32], grid: RangeGrid) -> RangeImage:
    """Return the nearest returns of (N, 3) level points."""
    points = np.ascontiguousarray(np.asarray(xyz, dtype=np.float32).T)
    cells, ranges = cells_of(points, grid.sensor_T_level, grid)
    nearest = _nearest(cells, ranges, grid.rows, grid.columns, grid.spherical)
    return RangeImage(nearest, _window_minimum(nearest))
