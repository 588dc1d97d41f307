"""The nearest return in every direction: what a sensor could see through, and what it could not.

A grid is spherical (LiDAR: azimuth by elevation in the sensor's own frame) or perspective (the
pixels of a depth image). Ranges are Euclidean distances from the sensor in metres; no return is
infinity. Images carry a border of one empty cell, so that 3x3 windows need no bounds; the azimuth
border repeats the other side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import EvidenceError
from tcrdata.geometry.transforms import inverse
from tcrdata.types import Float32Array, Frame, Sensor

_HALF_PI = np.float32(np.pi / 2)
_PI = np.float32(np.pi)


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


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _arctan2(y: np.float32, x: np.float32) -> np.float32:
    """Return the angle in radians, within 2e-5 (a hundredth of a cell), several times faster.

    Polynomial of Abramowitz & Stegun, "Handbook of Mathematical Functions", 4.4.47.
    """
    ax, ay = abs(x), abs(y)
    large = max(ax, ay)
    if large == np.float32(0.0):
        return np.float32(0.0)
    t = min(ax, ay) / large
    s = t * t
    angle = t * (
        np.float32(0.9998660)
        + s
        * (
            np.float32(-0.3302995)
            + s * (np.float32(0.1801410) + s * (np.float32(-0.0851330) + s * np.float32(0.0208351)))
        )
    )
    if ay > ax:
        angle = _HALF_PI - angle
    if x < 0:
        angle = _PI - angle
    return -angle if y < 0 else angle


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def locate(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    spherical: bool,
    rows: int,
    columns: int,
    numbers: Float32Array,
) -> tuple[int, int, np.float32]:
    """Return the cell (row, column, border counted in) of a sensor point, and its range.

    The row is -1 when the point has no cell.
    """
    flat = np.float32(x * x + y * y)
    distance = np.float32(np.sqrt(flat + z * z))
    if spherical:
        elevation = _arctan2(z, np.float32(np.sqrt(flat)))
        row = int(np.floor((numbers[2] - elevation) * numbers[1]))
        column = int(np.floor((_PI - _arctan2(y, x)) * numbers[0])) % columns
    else:
        if z <= 0:
            return -1, 0, distance
        row = int(np.floor(numbers[1] * y / z + numbers[3] + np.float32(0.5)))
        column = int(np.floor(numbers[0] * x / z + numbers[2] + np.float32(0.5)))
        if column < 0 or column >= columns:
            return -1, 0, distance
    if row < 0 or row >= rows:
        return -1, 0, distance
    return row + 1, column + 1, distance


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _fill(
    xyz: Float32Array,
    T: Float32Array,
    spherical: bool,
    rows: int,
    columns: int,
    numbers: Float32Array,
) -> Float32Array:
    image = np.full((rows + 2, columns + 2), np.float32(np.inf), np.float32)
    for i in range(len(xyz)):
        px, py, pz = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        row, column, distance = locate(x, y, z, spherical, rows, columns, numbers)
        if row > 0 and distance < image[row, column]:
            image[row, column] = distance
    if spherical:
        image[:, 0] = image[:, columns]
        image[:, columns + 1] = image[:, 1]
    return image


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
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
    nearest = _fill(
        np.ascontiguousarray(xyz, dtype=np.float32),
        grid.sensor_T_level,
        grid.spherical,
        grid.rows,
        grid.columns,
        grid.numbers,
    )
    return RangeImage(nearest, _window_minimum(nearest))
