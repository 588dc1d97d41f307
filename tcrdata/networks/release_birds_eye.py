"""The released code's detector: occupied voxels from above, heights as channels.

Stem of 64 channels, stages of 64, 96, 128 and 128, output stride 4, with segmentation channels
beside the heads. A voxel of x and z is 0.125 m, one of y 0.25 m; a segmentation cell is 0.5 m from
above and 1 m high.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import nn

from tcrdata.networks.blocks import ConvNorm, Residual, UpAndAdd, blended
from tcrdata.networks.center_heads import BIRDS_EYE_HEADS, CenterHeads
from tcrdata.networks.center_targets import (
    LabelBoxes,
    Targets,
    TargetSettings,
    center_targets,
    segmentation_targets,
)
from tcrdata.networks.grids import GridSettings, Sweep, voxel_image
from tcrdata.types import BoolArray, Float32Array

KIND: Literal["detector"] = "detector"


@dataclass(frozen=True)
class Settings(GridSettings):
    """The network's size; outputs are four times as large as input cells.

    Attributes:
        top_m: y of the region's upper face; y points down from the camera.
        layer_m: height of an input's layer.
        layers: layers of the input.
        stem: channels of the first convolution, stride 2.
        widths: channels at strides 4, 8, 16 and 32.
        segmentation_layers: channels that tell which cells lie inside of objects.
        head_width: hidden channels of a head.
    """

    cell_m: float = 0.125
    top_m: float = -2.0
    layer_m: float = 0.25
    layers: int = 16
    stem: int = 64
    widths: tuple[int, ...] = (64, 96, 128, 128)
    segmentation_layers: int = 4
    head_width: int = 64

    @property
    def stride(self) -> int:
        """Input cells a side of an output cell."""
        return 4


class ReleaseBirdsEyeDetector(nn.Module):
    """Strided stages, brought back together at stride 4."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        widths = settings.widths
        steps = list(zip((settings.stem, *widths), widths, strict=False))
        self.stem = ConvNorm(settings.layers, settings.stem, 5, 2)
        self.stages = nn.ModuleList(
            nn.Sequential(Residual(before, after, 2), Residual(after, after))
            for before, after in steps
        )
        self.up = nn.ModuleList(
            UpAndAdd(coarse, fine) for fine, coarse in itertools.pairwise(widths)
        )
        heads = {**BIRDS_EYE_HEADS, "segmentation": settings.segmentation_layers}
        self.heads = CenterHeads(widths[0], heads, settings.head_width)

    def forward(self, image: torch.Tensor) -> dict[str, torch.Tensor]:
        """(B, layers, rows, columns) to raw outputs of a quarter of the rows and columns."""
        features, levels = self.stem(image), []
        for stage in self.stages:
            features = stage(features)
            levels.append(features)
        outputs: dict[str, torch.Tensor] = self.heads(blended(levels, self.up))
        return outputs


def image_of(sweep: Sweep, settings: Settings) -> Float32Array:
    """Return the network's input for a sweep, without the batch dimension: occupied voxels."""
    nothing = np.empty((len(sweep.xyz), 0), dtype=np.float32)
    voxels = voxel_image(
        sweep.xyz, nothing, settings.region, settings.top_m, settings.layer_m, settings.layers
    )
    return np.asarray(voxels[0])


def targets_of(
    labels: LabelBoxes, known: BoolArray, settings: Settings, shape: TargetSettings
) -> Targets:
    """Return what the network should say; `known` is as in `center_targets`."""
    region = settings.region.coarser(settings.stride)
    layers = settings.segmentation_layers
    layer_m = settings.layer_m * settings.layers / layers
    inside = segmentation_targets(labels, region, known, settings.top_m, layer_m, layers)
    return {**center_targets(labels, region, known, shape), **inside}


def make_network(settings: Settings) -> ReleaseBirdsEyeDetector:
    """Return an untrained network."""
    return ReleaseBirdsEyeDetector(settings)
