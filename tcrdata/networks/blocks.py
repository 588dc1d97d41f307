"""Building blocks that several networks share."""

from __future__ import annotations

import torch
from torch import nn


class ConvNorm(nn.Sequential):
    """A convolution without bias, batch normalisation and, unless it ends a block, ReLU."""

    def __init__(
        self, inputs: int, outputs: int, size: int = 3, stride: int = 1, *, relu: bool = True
    ) -> None:
        convolution = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
        layers: list[nn.Module] = [convolution, nn.BatchNorm2d(outputs)]
        super().__init__(*layers, *([nn.ReLU(inplace=True)] if relu else []))


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside a shortcut (He et al., CVPR 2016)."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            ConvNorm(inputs, outputs, 3, stride), ConvNorm(outputs, outputs, relu=False)
        )
        same = inputs == outputs and stride == 1
        self.shortcut = nn.Identity() if same else ConvNorm(inputs, outputs, 1, stride, relu=False)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(B, inputs, H, W) to (B, outputs, H / stride, W / stride)."""
        return torch.relu(self.body(features) + self.shortcut(features))


class UpAndAdd(nn.Module):
    """Brings coarse features to the size of finer ones, adds both and blends them."""

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.narrow = ConvNorm(coarse, fine, 1)
        self.blend = Residual(fine, fine)

    def forward(self, coarse: torch.Tensor, fine: torch.Tensor) -> torch.Tensor:
        """(B, coarse, h, w) and (B, fine, H, W) to (B, fine, H, W)."""
        narrow = nn.functional.interpolate(self.narrow(coarse), fine.shape[-2:], mode="nearest")
        return self.blend(narrow + fine)


def blended(levels: list[torch.Tensor], up: nn.ModuleList) -> torch.Tensor:
    """Return the finest level with all coarser ones brought up to it.

    Args:
        levels: features from fine to coarse, (B, channels, H, W) each.
        up: an `UpAndAdd` for each pair of neighbours, from fine to coarse.
    """
    features = levels[-1]
    for blend, fine in zip(reversed(up), reversed(levels[:-1]), strict=True):
        features = blend(features, fine)
    return features
