"""Points to grids: what a detector sees of a sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.transforms import level_project
from tcrdata.types import BoolArray, Float32Array, FloatArray, Frame, ImageArray, IntArray


@dataclass(frozen=True)
class Region:
    """The ground that a detector covers, level frame: |x| <= lateral_m, near_m <= z < far_m.

    Attributes:
        lateral_m: half width.
        near_m: nearest z.
        far_m: farthest z.
        cell_m: side of an input's cell.
    """

    lateral_m: float = 20.0
    near_m: float = 0.0
    far_m: float = 40.0
    cell_m: float = 0.25

    @property
    def columns(self) -> int:
        """Cells along x."""
        return round(2 * self.lateral_m / self.cell_m)

    @property
    def rows(self) -> int:
        """Cells along z."""
        return round((self.far_m - self.near_m) / self.cell_m)

    def coarser(self, stride: int) -> Region:
        """Return the same ground in cells `stride` times as large."""
        return Region(self.lateral_m, self.near_m, self.far_m, self.cell_m * stride)

    def cells(self, x: NDArray[np.floating], z: NDArray[np.floating]) -> tuple[IntArray, BoolArray]:
        """Return (N,) flat cells, row * columns + column, and which of them lie inside."""
        column = np.floor((x + self.lateral_m) / self.cell_m)
        row = np.floor((z - self.near_m) / self.cell_m)
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        flat = np.where(inside, row * self.columns + column, 0).astype(np.int64)
        return flat, inside

    def centers(self) -> tuple[Float32Array, Float32Array]:
        """Return (columns,) x and (rows,) z of the cells' centres."""
        x = (np.arange(self.columns) + 0.5) * self.cell_m - self.lateral_m
        z = (np.arange(self.rows) + 0.5) * self.cell_m + self.near_m
        return x.astype(np.float32), z.astype(np.float32)


@dataclass(frozen=True)
class GridSettings:
    """The ground that a detector covers, in metres of a road scene; the released code's.

    Attributes:
        lateral_m: half width of the region.
        near_m: nearest z.
        far_m: farthest z.
        cell_m: side of an input's cell seen from above.
    """

    lateral_m: float = 16.0
    near_m: float = 2.0
    far_m: float = 34.0
    cell_m: float = 0.25

    @property
    def region(self) -> Region:
        """The ground covered, in input cells."""
        return Region(self.lateral_m, self.near_m, self.far_m, self.cell_m)

    @property
    def stride(self) -> int:
        """Input cells a side of an output cell."""
        return 2

    @property
    def volume_top_m(self) -> float | None:
        """Y of an output volume's upper face; None where the outputs are seen from above."""
        return None


@dataclass(frozen=True)
class HeightSlices:
    """How the points above a cell are cut.

    Attributes:
        count: slices.
        slice_m: height of each.
        lowest_m: bottom of the first, above the ground.
    """

    count: int = 12
    slice_m: float = 0.25
    lowest_m: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """The points of a frame, as detectors get them; metres of a road scene.

    Attributes:
        xyz: (N, 3) level frame.
        height_m: (N,) above the ground; NaN where unknown.
        ground: (N,) whether each point is ground.
        colours: (N, 3) in [0, 1]; zeros where no camera sees the point.
    """

    xyz: NDArray[np.floating]
    height_m: NDArray[np.floating]
    ground: BoolArray
    colours: NDArray[np.floating]


BIRDS_EYE_EXTRAS = 4
"""Channels beside the slices: log count, largest height, observed, range."""

_TOP_M = 4.0
_LOG_COUNT = 4.0


def birds_eye_image(sweep: Sweep, region: Region, slices: HeightSlices) -> Float32Array:
    """Return the (slices + 4, rows, columns) image of a sweep from above.

    Each slice tells whether a point that is not ground lies in it; then come the log of their
    number, the largest of their heights, whether any point lies in the cell, and the range.

    Args:
        sweep: the points.
        region: the ground covered.
        slices: how heights are cut.
    """
    cells, inside = region.cells(sweep.xyz[:, 0], sweep.xyz[:, 2])
    height_m = sweep.height_m
    size = region.rows * region.columns
    image = np.zeros((slices.count + BIRDS_EYE_EXTRAS, size), dtype=np.float32)
    level = np.floor((height_m - slices.lowest_m) / slices.slice_m)
    solid = inside & ~sweep.ground & (level >= 0) & (height_m < _TOP_M)
    chosen = solid & (level < slices.count)
    image[level[chosen].astype(np.int64), cells[chosen]] = 1.0
    counts = np.bincount(cells[solid], minlength=size)
    image[slices.count] = np.log1p(counts) / _LOG_COUNT
    np.maximum.at(image[slices.count + 1], cells[solid], height_m[solid] / _TOP_M)
    image[slices.count + 2, cells[inside]] = 1.0
    x, z = region.centers()
    image[slices.count + 3] = (np.hypot(x[None], z[:, None]) / region.far_m).ravel()
    return image.reshape(-1, region.rows, region.columns)


def projected(frame: Frame, xyz: NDArray[np.floating]) -> FloatArray:
    """Return (N, 2) pixels of points, metres; NaN where the camera does not see them."""
    pixels = np.full((len(xyz), 2), np.nan)
    if frame.level_projection is None or frame.camera is None:
        return pixels
    ahead = np.flatnonzero(xyz[:, 2] > 0)
    found, depth = level_project(frame.level_projection, xyz[ahead])
    u, v = found.T
    seen = (depth > 0) & (u >= 0) & (u < frame.camera.width_px)
    seen &= (v >= 0) & (v < frame.camera.height_px)
    pixels[ahead[seen]] = found[seen]
    return pixels


def pixel_colours(
    image: ImageArray | None, frame: Frame, xyz: NDArray[np.floating]
) -> Float32Array:
    """Return (N, 3) colours in [0, 1] of the points' pixels; zeros where there are none."""
    colours = np.zeros((len(xyz), 3), dtype=np.float32)
    if image is not None:
        pixels = projected(frame, xyz)
        seen = np.isfinite(pixels[:, 0])
        column, line = pixels[seen].astype(np.int64).T
        colours[seen] = image[line, column] / np.float32(255)
    return colours


def voxel_image(
    xyz: NDArray[np.floating],
    features: NDArray[np.floating],
    region: Region,
    top_m: float,
    layer_m: float,
    layers: int,
) -> Float32Array:
    """Return the (1 + F, layers, rows, columns) voxels: occupancy, then the mean of features.

    Args:
        xyz: (N, 3) points, level frame.
        features: (N, F), such as colours in [0, 1].
        region: the ground covered.
        top_m: y of the first layer's upper face; y points down.
        layer_m: height of a voxel.
        layers: voxels along y.
    """
    cells, inside = region.cells(xyz[:, 0], xyz[:, 2])
    layer = np.floor((xyz[:, 1] - top_m) / layer_m).astype(np.int64)
    inside &= (layer >= 0) & (layer < layers)
    flat = layer[inside] * (region.rows * region.columns) + cells[inside]
    size = layers * region.rows * region.columns
    counts = np.bincount(flat, minlength=size)
    image = np.empty((1 + features.shape[1], size), dtype=np.float32)
    image[0] = counts > 0
    for number in range(features.shape[1]):
        sums = np.bincount(flat, weights=features[inside, number], minlength=size)
        image[1 + number] = sums / np.maximum(counts, 1)
    return image.reshape(-1, layers, region.rows, region.columns)
