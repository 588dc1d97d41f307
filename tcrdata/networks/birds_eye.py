"""The default detector: a small CenterNet over the sweep seen from above."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import torch
from torch import nn

from tcrdata.networks.blocks import ConvNorm, Residual, UpAndAdd, blended
from tcrdata.networks.center_heads import BIRDS_EYE_HEADS, CenterHeads
from tcrdata.networks.center_targets import (
    LabelBoxes,
    Targets,
    TargetSettings,
    center_targets,
)
from tcrdata.networks.grids import (
    BIRDS_EYE_EXTRAS,
    GridSettings,
    HeightSlices,
    Sweep,
    birds_eye_image,
)
from tcrdata.types import BoolArray, Float32Array

KIND: Literal["detector"] = "detector"


@dataclass(frozen=True)
class Settings(GridSettings):
    """The network's size; outputs are twice as large as input cells.

    Attributes:
        slices: height slices of 0.25 m above the ground.
        widths: channels at strides 2, 4 and 8.
        head_width: hidden channels of a head.
    """

    lateral_m: float = 20.0
    near_m: float = 0.0
    far_m: float = 40.0
    slices: int = 12
    widths: tuple[int, ...] = (24, 48, 72)
    head_width: int = 24

    @property
    def height_slices(self) -> HeightSlices:
        """How heights are cut."""
        return HeightSlices(self.slices)


class BirdsEyeDetector(nn.Module):
    """A residual U-Net whose finest level has stride 2, under the heads of a CenterNet."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        widths = settings.widths
        self.stem = nn.Sequential(
            ConvNorm(settings.slices + BIRDS_EYE_EXTRAS, widths[0], 3, 2),
            Residual(widths[0], widths[0]),
        )
        self.down = nn.ModuleList(
            nn.Sequential(Residual(fine, coarse, 2), Residual(coarse, coarse))
            for fine, coarse in itertools.pairwise(widths)
        )
        self.up = nn.ModuleList(
            UpAndAdd(coarse, fine) for fine, coarse in itertools.pairwise(widths)
        )
        self.heads = CenterHeads(widths[0], BIRDS_EYE_HEADS, settings.head_width)

    def forward(self, image: torch.Tensor) -> dict[str, torch.Tensor]:
        """(B, slices + 4, rows, columns) to raw outputs of half the rows and columns."""
        levels = [self.stem(image)]
        for stage in self.down:
            levels.append(stage(levels[-1]))
        outputs: dict[str, torch.Tensor] = self.heads(blended(levels, self.up))
        return outputs


def image_of(sweep: Sweep, settings: Settings) -> Float32Array:
    """Return the network's input for a sweep, without the batch dimension."""
    return birds_eye_image(sweep, settings.region, settings.height_slices)


def targets_of(
    labels: LabelBoxes, known: BoolArray, settings: Settings, shape: TargetSettings
) -> Targets:
    """Return what the network should say; `known` is as in `center_targets`."""
    return center_targets(labels, settings.region.coarser(settings.stride), known, shape)


def make_network(settings: Settings) -> BirdsEyeDetector:
    """Return an untrained network."""
    return BirdsEyeDetector(settings)
