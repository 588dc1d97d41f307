"""ResNet-18 and -50 (He et al., CVPR 2016) as backbones.

Parameters have the names of torchvision's models, so that a file of ImageNet weights fits; in the
bottleneck the 3 x 3 convolution has the stride, as there.
"""

from __future__ import annotations

from collections import OrderedDict

import torch
from torch import nn

DEPTHS = {18: (2, 2, 2, 2), 50: (3, 4, 6, 3)}
BOTTLENECKED = frozenset({50})


class _Basic(nn.Module):
    expansion = 1

    def __init__(self, inputs: int, width: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, width, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample = _shortcut(inputs, width, stride)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        shortcut = features if self.downsample is None else self.downsample(features)
        features = torch.relu(self.bn1(self.conv1(features)))
        return torch.relu(self.bn2(self.conv2(features)) + shortcut)


class _Bottleneck(nn.Module):
    expansion = 4

    def __init__(self, inputs: int, width: int, stride: int) -> None:
        super().__init__()
        outputs = width * self.expansion
        self.conv1 = nn.Conv2d(inputs, width, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, stride, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = nn.Conv2d(width, outputs, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(outputs)
        self.downsample = _shortcut(inputs, outputs, stride)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        shortcut = features if self.downsample is None else self.downsample(features)
        features = torch.relu(self.bn1(self.conv1(features)))
        features = torch.relu(self.bn2(self.conv2(features)))
        return torch.relu(self.bn3(self.conv3(features)) + shortcut)


class ResNet(nn.Module):
    """The four stages of a ResNet, without its classifier.

    Args:
        depth: 18 or 50.

    Attributes:
        channels: of the four stages, at strides 4, 8, 16 and 32.
    """

    def __init__(self, depth: int) -> None:
        super().__init__()
        block = _Bottleneck if depth in BOTTLENECKED else _Basic
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.channels = [width * block.expansion for width in (64, 128, 256, 512)]
        inputs = 64
        for number, blocks in enumerate(DEPTHS[depth]):
            width, stride = 64 * 2**number, 1 if number == 0 else 2
            stage = OrderedDict[str, nn.Module]()
            for index in range(blocks):
                stage[str(index)] = block(inputs, width, stride if index == 0 else 1)
                inputs = width * block.expansion
            self.add_module(f"layer{number + 1}", nn.Sequential(stage))

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        """(B, 3, H, W) to four feature maps, (B, channels[i], H / 4 / 2**i, W / 4 / 2**i)."""
        features = torch.relu(self.bn1(self.conv1(image)))
        features = nn.functional.max_pool2d(features, 3, 2, 1)
        levels = []
        for stage in (self.layer1, self.layer2, self.layer3, self.layer4):
            features = stage(features)
            levels.append(features)
        return levels


def _shortcut(inputs: int, outputs: int, stride: int) -> nn.Sequential | None:
    if inputs == outputs and stride == 1:
        return None
    return nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs))
