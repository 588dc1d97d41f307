"""The paper's detector: a colourised voxel grid, a 3D U-Net, and a CenterNet head in 3D.

Outputs: 1 centre heatmap, 3 size, 3 sub-voxel offset, 16 bins of heading, at half the resolution.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import torch
from torch import nn

from tcrdata.networks.center_heads import HEADING_BINS, CenterHeads
from tcrdata.networks.center_targets import (
    LabelBoxes,
    Targets,
    TargetSettings,
    center_targets,
)
from tcrdata.networks.grids import GridSettings, Sweep, voxel_image
from tcrdata.types import BoolArray, Float32Array

KIND: Literal["detector"] = "detector"
NEEDS_COLOURS = True
COLOUR_CHANNELS = 4
HEADS = {"center": 1, "offset": 3, "log_size": 3, "heading": HEADING_BINS}


@dataclass(frozen=True)
class Settings(GridSettings):
    """The network's size; a voxel is a cube of `cell_m`, outputs are twice as large.

    Attributes:
        top_m: y of the region's upper face; y points down from the camera.
        layers: voxels along y.
        widths: channels at strides 2, 4 and 8.
        head_width: hidden channels of a head.
    """

    top_m: float = -2.0
    layers: int = 16
    widths: tuple[int, ...] = (16, 32, 64)
    head_width: int = 16

    @property
    def volume_top_m(self) -> float | None:
        """Y of the output volume's upper face."""
        return self.top_m


class _Block(nn.Sequential):
    """Two 3 x 3 x 3 convolutions; the first may be strided."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        layers: list[nn.Module] = []
        for before, step in ((inputs, stride), (outputs, 1)):
            layers += [
                nn.Conv3d(before, outputs, 3, step, 1, bias=False),
                nn.BatchNorm3d(outputs),
                nn.ReLU(inplace=True),
            ]
        super().__init__(*layers)


class VolumeDetector(nn.Module):
    """A 3D U-Net with additive skips under 3D heads."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        widths = settings.widths
        steps = list(zip((COLOUR_CHANNELS, *widths), widths, strict=False))
        self.down = nn.ModuleList(_Block(before, after, 2) for before, after in steps)
        pairs = list(itertools.pairwise(widths))
        self.narrow = nn.ModuleList(nn.Conv3d(coarse, fine, 1) for fine, coarse in pairs)
        self.blend = nn.ModuleList(_Block(fine, fine) for fine, _ in pairs)
        self.heads = CenterHeads(widths[0], HEADS, settings.head_width, dimensions=3)

    def forward(self, voxels: torch.Tensor) -> dict[str, torch.Tensor]:
        """(B, 4, layers, rows, columns) to raw outputs of half of each."""
        features, levels = voxels, []
        for stage in self.down:
            features = stage(features)
            levels.append(features)
        features = levels.pop()
        for narrow, blend in zip(reversed(self.narrow), reversed(self.blend), strict=True):
            fine = levels.pop()
            coarse = nn.functional.interpolate(narrow(features), fine.shape[-3:], mode="nearest")
            features = blend(coarse + fine)
        outputs: dict[str, torch.Tensor] = self.heads(features)
        return outputs


def image_of(sweep: Sweep, settings: Settings) -> Float32Array:
    """Return the network's input for a sweep, without the batch dimension: coloured voxels."""
    return voxel_image(
        sweep.xyz,
        sweep.colours,
        settings.region,
        settings.top_m,
        settings.cell_m,
        settings.layers,
    )


def targets_of(
    labels: LabelBoxes, known: BoolArray, settings: Settings, shape: TargetSettings
) -> Targets:
    """Return what the network should say; `known` is as in `center_targets`."""
    layers = (settings.top_m, settings.layers // settings.stride)
    return center_targets(labels, settings.region.coarser(settings.stride), known, shape, layers)


def make_network(settings: Settings) -> VolumeDetector:
    """Return an untrained network."""
    return VolumeDetector(settings)
