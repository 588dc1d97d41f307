"""Heads of a CenterNet (Zhou et al., "Objects as Points", 2019) over any grid of features."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import nn

CENTER = "center"
PRIOR = 0.05
"""Probability of a centre that an untrained network says: keeps the first losses small."""

BIRDS_EYE_HEADS = {CENTER: 1, "offset": 2, "log_size": 3, "axis": 2, "direction": 2}
"""Channels: the centre's heat; its offset (x, z) from the cell's middle in cells; log of length,
width and height; cos and sin of twice the yaw; cos and sin of the yaw in which it moves."""

HEADING_BINS = 16
"""Bins of heading in the paper's head."""


class CenterHeads(nn.Module):
    """One small head for each output.

    Args:
        inputs: channels of the features.
        channels: output to its number of channels.
        width: hidden channels of a head.
        dimensions: 2 for a map from above, 3 for a volume.
    """

    def __init__(
        self, inputs: int, channels: Mapping[str, int], width: int, dimensions: int = 2
    ) -> None:
        super().__init__()
        convolution = nn.Conv2d if dimensions == 2 else nn.Conv3d
        self.heads = nn.ModuleDict(
            {
                name: nn.Sequential(
                    convolution(inputs, width, 3, padding=1),
                    nn.ReLU(inplace=True),
                    convolution(width, outputs, 1),
                )
                for name, outputs in channels.items()
            }
        )
        last = self.heads[CENTER][-1]
        nn.init.constant_(last.bias, -math.log((1 - PRIOR) / PRIOR))

    def forward(self, features: torch.Tensor) -> dict[str, torch.Tensor]:
        """(B, inputs, ...) to output name: (B, channels, ...), all raw numbers."""
        return {name: head(features) for name, head in self.heads.items()}
