"""What RAFT sees of an image: features at an eighth of its size, by residual stages.

Parameters have the names and shapes of the published networks, so that their files fit; a norm
that shrinks the shortcut too is listed under both of its names, as there.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import nn

Norm = Literal["instance", "batch", "none"]


class _Residual(nn.Module):
    """Convolutions whose sum with a shortcut is rectified; the first `stride` is the shortcut's."""

    def __init__(self, shapes: list[tuple[int, int, int, int]], norm: Norm) -> None:
        """Make a convolution of each (inputs, outputs, kernel, stride), numbered from 1."""
        super().__init__()
        self._count = len(shapes)
        for number, (inputs, outputs, kernel, stride) in enumerate(shapes, start=1):
            convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2)
            self.add_module(f"conv{number}", convolution)
            self.add_module(f"norm{number}", _norm(norm, outputs))
        first, last, stride = shapes[0][0], shapes[-1][1], max(shape[3] for shape in shapes)
        self.downsample: nn.Module | None = None
        if stride > 1:
            shared = _norm(norm, last)
            self.add_module(f"norm{self._count + 1}", shared)
            self.downsample = nn.Sequential(nn.Conv2d(first, last, 1, stride), shared)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        found = features
        for number in range(1, self._count + 1):
            convolution, norm = getattr(self, f"conv{number}"), getattr(self, f"norm{number}")
            found = torch.relu(norm(convolution(found)))
        shortcut = features if self.downsample is None else self.downsample(features)
        return torch.relu(shortcut + found)


class Encoder(nn.Module):
    """Three stages of two residual blocks each, at strides 2, 4 and 8.

    Args:
        widths: channels of the stages.
        outputs: channels of the features.
        norm: after each convolution.
        bottleneck: blocks of 1x1, 3x3, 1x1 at a quarter of the width, for two of 3x3.
    """

    def __init__(
        self, widths: tuple[int, int, int], outputs: int, norm: Norm, *, bottleneck: bool
    ) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, widths[0], 7, 2, 3)
        self.norm1 = _norm(norm, widths[0])
        inputs = widths[0]
        for number, width in enumerate(widths, start=1):
            blocks = []
            for stride in (1 if number == 1 else 2, 1):
                shapes = _shapes(inputs, width, stride, bottleneck)
                blocks.append(_Residual(shapes, norm))
                inputs = width
            self.add_module(f"layer{number}", nn.Sequential(*blocks))
        self.conv2 = nn.Conv2d(inputs, outputs, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) in [-1, 1], H and W multiples of 8, to (B, outputs, H / 8, W / 8)."""
        features = torch.relu(self.norm1(self.conv1(image)))
        features = self.layer3(self.layer2(self.layer1(features)))
        return self.conv2(features)


def _shapes(
    inputs: int, width: int, stride: int, bottleneck: bool
) -> list[tuple[int, int, int, int]]:
    if not bottleneck:
        return [(inputs, width, 3, stride), (width, width, 3, 1)]
    narrow = width // 4
    return [(inputs, narrow, 1, 1), (narrow, narrow, 3, stride), (narrow, width, 1, 1)]


def _norm(norm: Norm, channels: int) -> nn.Module:
    if norm == "batch":
        return nn.BatchNorm2d(channels)
    return nn.InstanceNorm2d(channels) if norm == "instance" else nn.Identity()
