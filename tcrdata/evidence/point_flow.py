"""From flow in the image to flow of 3D points.

Both clouds are projected. A point takes part when it is the nearest in its pixel; its flow ends
at a pixel, and when that pixel has a nearest point too, the pair of points is a 3D displacement.

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import FrameError
from tcrdata.geometry.kernels import compiled
from tcrdata.types import Dataset, Float32Array, FloatArray, Frame, IntArray, PointCloud


@compiled
def project(
    xyz: NDArray[np.floating[Any]], projection: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Project (N, 3) level points, in one thread, so that bits do not depend on their number.

    Returns:
        (N, 2) pixels (column, row), NaN behind the camera, and (N,) depths in metres.
    """
    pixels = np.full((len(xyz), 2), np.nan)
    depths = np.empty(len(xyz))
    p = projection
    for i in range(len(xyz)):
        x, y, z = float(xyz[i, 0]), float(xyz[i, 1]), float(xyz[i, 2])
        depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
        depths[i] = depth
        if depth > 0:
            pixels[i, 0] = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / depth
            pixels[i, 1] = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / depth
    return pixels, depths


@compiled
def moved(xyz: NDArray[np.floating[Any]], to_T_from: FloatArray) -> FloatArray:
    """Carry (N, 3) points by a (4, 4) motion, in one thread, for the same reason."""
    result = np.empty((len(xyz), 3))
    m = to_T_from
    for i in range(len(xyz)):
        x, y, z = float(xyz[i, 0]), float(xyz[i, 1]), float(xyz[i, 2])
        for j in range(3):
            result[i, j] = m[j, 0] * x + m[j, 1] * y + m[j, 2] * z + m[j, 3]
    return result


@dataclass(frozen=True)
class PixelIndex:
    """The nearest point of each pixel.

    Attributes:
        xyz: (N, 3) float32 points, level frame, metres.
        points: (M,) indices of the points that are nearest in their pixel, by pixel row by row.
        columns: (M,) their pixels.
        rows: (M,) their pixels.
        grid: (H, W) index of the pixel's point, -1 without one.
    """

    xyz: Float32Array
    points: IntArray
    columns: IntArray
    rows: IntArray
    grid: NDArray[np.int32]


def projection_of(frame: Frame) -> FloatArray:
    """Return the (3, 4) level projection of a frame; raises FrameError without a camera."""
    projection = frame.level_projection
    if projection is None:
        raise FrameError(f"frame {frame.frame} of {frame.sequence} has no camera: calibrate it")
    return projection


def pixel_index(
    dataset: Dataset, frame: Frame, width: int, height: int, near_m: float
) -> PixelIndex:
    """Read a frame's points and find the nearest of each pixel; raises FrameError."""
    projection = projection_of(frame)
    return index_points(dataset.read_points(frame), projection, width, height, near_m)


def nearest_pixels(
    cloud: PointCloud, projection: FloatArray, points: IntArray | None = None
) -> tuple[IntArray, FloatArray]:
    """Return the nearest whole-number pixels, (N, 2) column and row, and (N,) depths of points.

    A depth camera's own pixels are used where it gives them. Pixels behind the camera are -1.

    Args:
        cloud: the frame's points.
        projection: (3, 4), level frame to homogeneous pixels.
        points: which points; all by default.
    """
    chosen: IntArray | slice = slice(None) if points is None else points
    uv, depth = project(cloud.xyz[chosen], projection)
    if cloud.pixels is not None:
        return cloud.pixels[chosen].astype(np.int64), depth
    # Far outside the image a pixel may not fit an integer: any negative one will do.
    shown = ((depth > 0) & (np.abs(uv) < 2**31).all(axis=1))[:, None]
    return np.where(shown, np.floor(np.where(shown, uv, 0.0) + 0.5), -1.0).astype(np.int64), depth


def index_points(
    cloud: PointCloud, projection: FloatArray, width: int, height: int, near_m: float
) -> PixelIndex:
    """Find the nearest point of each pixel.

    Args:
        cloud: N points; a depth camera's own pixels are used where it gives them.
        projection: (3, 4), level frame to homogeneous pixels.
        width: image width, px.
        height: image height, px.
        near_m: points at a depth of at most this are left out.
    """
    pixels, depth = nearest_pixels(cloud, projection)
    usable = (depth > near_m) & (pixels >= 0).all(axis=1)
    points = np.flatnonzero(usable & (pixels[:, 0] < width) & (pixels[:, 1] < height))
    cells = pixels[points, 1] * width + pixels[points, 0]
    # Written far to near, so that the nearest stays; of equals the first in the cloud.
    order = np.lexsort((-points, -depth[points]))
    grid = np.full(height * width, -1, np.int32)
    grid[cells[order]] = points[order]
    filled = np.flatnonzero(grid >= 0)
    nearest = grid[filled].astype(np.int64)
    return PixelIndex(
        cloud.xyz, nearest, filled % width, filled // width, grid.reshape(height, width)
    )


def ends(index: PixelIndex, other: PixelIndex, flow: Float32Array) -> IntArray:
    """Return (M,): the other frame's point at which the flow of each point ends, or -1.

    Args:
        index: of the frame in which the flow starts.
        other: of the frame in which it ends.
        flow: (H, W, 2) px.
    """
    height, width = other.grid.shape
    step = flow[index.rows, index.columns].astype(np.float64)
    columns = np.floor(index.columns + step[:, 0] + 0.5)
    rows = np.floor(index.rows + step[:, 1] + 0.5)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = np.full(len(index.points), -1, np.int64)
    found[inside] = other.grid[rows[inside].astype(np.int64), columns[inside].astype(np.int64)]
    return found


def rigid_flow(
    points: Float32Array, to_T_from: FloatArray, projection: FloatArray, projection_to: FloatArray
) -> FloatArray:
    """Return the (M, 2) flow in pixels that a rigid motion gives (M, 3) points of the level frame.

    NaN where a point is, or ends, behind the camera.
    """
    before, _ = project(points, projection)
    after, _ = project(moved(points, to_T_from), projection_to)
    return after - before
