"""What a CenterNet should say of a frame: heat at the labels' centres, and their boxes there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.networks.center_heads import HEADING_BINS
from tcrdata.networks.grids import Region
from tcrdata.types import BoolArray, Float32Array, FloatArray

Targets = dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class LabelBoxes:
    """The labels of one frame.

    Attributes:
        boxes: (M, 7) x, y, z, length, width, height, yaw; metres of a road scene, level frame.
        positive: (M,) true for labels, false for what is to be ignored.
        moving: (M,) whether the yaw tells where the object heads.
    """

    boxes: FloatArray
    positive: BoolArray
    moving: BoolArray

    def __len__(self) -> int:
        return len(self.boxes)


@dataclass(frozen=True)
class TargetSettings:
    """The shape of the targets.

    Attributes:
        spread: standard deviation of the heat, in sides of the box.
        least_cells: smallest standard deviation, in cells.
        box_heat: boxes are learnt where the heat is larger.
        ignore_margin_m: nothing is learnt this far around what is to be ignored.
    """

    spread: float = 0.15
    least_cells: float = 0.6
    box_heat: float = 0.3
    ignore_margin_m: float = 0.5


def center_targets(
    labels: LabelBoxes,
    region: Region,
    known: BoolArray,
    settings: TargetSettings,
    layers: tuple[float, int] | None = None,
) -> Targets:
    """Return the targets of one frame on an output grid.

    Args:
        labels: of the frame.
        region: the ground covered, in output cells.
        known: (rows, columns) where it is known that no object has its centre, labels aside.
        settings: shape of the targets.
        layers: for a volume (y of its top, number of layers of `region.cell_m`); None from above.

    Returns:
        arrays (channels, [layers,] rows, columns): `center` in [0, 1], `offset` in cells (x, z, or
        x, y, z), `log_size`, `axis`, `direction`, `heading` (number of the bin), and the weights
        `center_weight`, `box_weight` and `direction_weight`, one channel each.
    """
    grid = _cell_centers(region, layers)
    shape = grid.shape[1:]
    weight = np.broadcast_to(known, shape).astype(np.float32)
    heat = np.zeros(shape, dtype=np.float32)
    owner = np.full(shape, -1, dtype=np.int64)
    for number in np.flatnonzero(~labels.positive):
        inside = _inside(grid, labels.boxes[number], settings.ignore_margin_m)
        weight[inside] = 0.0
    for number in np.flatnonzero(labels.positive):
        own = _heat(grid, labels.boxes[number], region.cell_m, settings)
        own_cell = _cell_of(labels.boxes[number], region, layers)
        if own_cell is not None:
            own[own_cell] = 1.0
        weight[own > 0.05] = 1.0
        owner[own > heat] = number
        heat = np.maximum(heat, own)
    targets = _box_targets(grid, labels, owner, region.cell_m, layers is not None)
    learnt = np.where((owner >= 0) & (heat >= settings.box_heat), heat, 0.0)
    moving = labels.moving[owner] if len(labels) else np.zeros(shape, bool)
    return {
        **targets,
        "center": heat[None],
        "center_weight": weight[None],
        "box_weight": learnt[None].astype(np.float32),
        "direction_weight": (learnt * moving)[None].astype(np.float32),
    }


def segmentation_targets(
    labels: LabelBoxes, region: Region, known: BoolArray, top_m: float, layer_m: float, layers: int
) -> Targets:
    """Return `segmentation` and its weight, (layers, rows, columns): cells inside of labels.

    Args:
        labels: of the frame.
        region: the ground covered, in output cells.
        known: (rows, columns) where it is known that there is no object, labels aside.
        top_m: y of the first layer's upper face.
        layer_m: height of a layer.
        layers: their number.
    """
    x, z = region.centers()
    y = (top_m + (np.arange(layers) + 0.5) * layer_m).astype(np.float32)
    grid = np.stack(np.meshgrid(y, z, x, indexing="ij"))[[2, 0, 1]]
    weight = np.broadcast_to(known, grid.shape[1:]).astype(np.float32)
    inside = np.zeros(grid.shape[1:], dtype=np.float32)
    for positive in (False, True):
        for number in np.flatnonzero(labels.positive == positive):
            own = _inside(grid, labels.boxes[number], 0.0)
            inside[own] = float(positive)
            weight[own] = float(positive)
    return {"segmentation": inside, "segmentation_weight": weight}


def _cell_centers(region: Region, layers: tuple[float, int] | None) -> Float32Array:
    """Return (2 or 3, [layers,] rows, columns): x, (y,) z of each cell."""
    x, z = region.centers()
    if layers is None:
        return np.stack(np.meshgrid(z, x, indexing="ij"))[::-1]
    y = (layers[0] + (np.arange(layers[1]) + 0.5) * region.cell_m).astype(np.float32)
    return np.stack(np.meshgrid(y, z, x, indexing="ij"))[[2, 0, 1]]


def _along(grid: Float32Array, box: FloatArray) -> tuple[Float32Array, ...]:
    """Return the cells' coordinates along the length, the width and, in a volume, the height."""
    dx, dz = grid[0] - box[0], grid[-1] - box[2]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    flat = (dx * cos - dz * sin, dx * sin + dz * cos)
    return flat if len(grid) == 2 else (*flat, grid[1] - box[1])


def _inside(grid: Float32Array, box: FloatArray, margin_m: float) -> BoolArray:
    inside = np.ones(grid.shape[1:], dtype=bool)
    for coordinate, side in zip(_along(grid, box), box[3:6], strict=False):
        inside &= np.abs(coordinate) <= side / 2 + margin_m
    return inside


def _heat(
    grid: Float32Array, box: FloatArray, cell_m: float, settings: TargetSettings
) -> Float32Array:
    """Return a Gaussian that is as long, wide and turned as the box."""
    exponent = np.zeros(grid.shape[1:], dtype=np.float32)
    for coordinate, side in zip(_along(grid, box), box[3:6], strict=False):
        deviation = max(side * settings.spread, settings.least_cells * cell_m)
        exponent += np.square(coordinate / deviation)
    return np.asarray(np.exp(-exponent / 2), dtype=np.float32)


def _cell_of(
    box: FloatArray, region: Region, layers: tuple[float, int] | None
) -> tuple[int, ...] | None:
    """Return the cell that holds a box's centre; None outside of the grid."""
    flat, inside = region.cells(box[:1], box[2:3])
    if not inside[0]:
        return None
    row, column = divmod(int(flat[0]), region.columns)
    if layers is None:
        return row, column
    layer = int(np.floor((box[1] - layers[0]) / region.cell_m))
    return (layer, row, column) if 0 <= layer < layers[1] else None


def _box_targets(
    grid: Float32Array, labels: LabelBoxes, owner: NDArray[np.int64], cell_m: float, volume: bool
) -> Targets:
    """Return each cell's box: that of the label whose heat is largest there."""
    boxes = labels.boxes if len(labels) else np.ones((1, 7))
    own = np.moveaxis(boxes[owner].astype(np.float32), -1, 0)
    place = own[:3] if volume else own[[0, 2]]
    yaw = own[6]
    turned = np.floor((yaw % (2 * np.pi)) / (2 * np.pi / HEADING_BINS)) % HEADING_BINS
    return {
        "offset": (place - grid) / np.float32(cell_m),
        "log_size": np.log(np.maximum(own[3:6], 0.05)),
        "axis": np.stack([np.cos(2 * yaw), np.sin(2 * yaw)]),
        "direction": np.stack([np.cos(yaw), np.sin(yaw)]),
        "heading": turned[None].astype(np.float32),
    }
