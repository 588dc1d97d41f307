"""2D objectness: a ResNet under a feature pyramid (Lin et al., CVPR 2017), one logit a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from pickle import UnpicklingError
from typing import Literal

import torch
from torch import nn

from tcrdata.errors import SettingsError
from tcrdata.networks.resnet import DEPTHS, ResNet

KIND: Literal["segmenter"] = "segmenter"
STRIDE = 4
MEAN = (0.485, 0.456, 0.406)
DEVIATION = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Settings:
    """The network's size.

    Attributes:
        depth: of the ResNet, 18 or 50.
        width: channels of the pyramid.
        backbone_weights: file with a ResNet's state dict under torchvision's names; empty for
            none.
    """

    depth: int = 18
    width: int = 64
    backbone_weights: str = ""

    def __post_init__(self) -> None:
        if self.depth not in DEPTHS:
            raise SettingsError(f"network.depth: {self.depth} is none of {sorted(DEPTHS)}")


class PyramidSegmenter(nn.Module):
    """Objectness of every 4 x 4 pixels: lateral and top-down paths, summed, then one head."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        width = settings.width
        self.backbone = ResNet(settings.depth)
        self.lateral = nn.ModuleList(nn.Conv2d(c, width, 1) for c in self.backbone.channels)
        self.smooth = nn.ModuleList(
            nn.Conv2d(width, width, 3, padding=1) for _ in self.backbone.channels
        )
        self.head = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=1), nn.ReLU(inplace=True), nn.Conv2d(width, 1, 1)
        )
        self.register_buffer("mean", torch.tensor(MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer(
            "deviation", torch.tensor(DEVIATION).view(1, 3, 1, 1), persistent=False
        )

    def forward(self, image: torch.Tensor) -> dict[str, torch.Tensor]:
        """(B, 3, H, W) in [0, 1] to `objectness`, (B, 1, H / 4, W / 4) logits."""
        levels = self.backbone((image - self.mean) / self.deviation)
        above: torch.Tensor | None = None
        merged: list[torch.Tensor] = []
        for level, lateral in zip(reversed(levels), reversed(self.lateral), strict=True):
            features = lateral(level)
            if above is not None:
                features = features + nn.functional.interpolate(above, features.shape[-2:])
            above = features
            merged.append(features)
        finest = merged[-1].shape[-2:]
        smoothed = [
            nn.functional.interpolate(smooth(features), finest, mode="bilinear")
            for smooth, features in zip(reversed(self.smooth), merged, strict=True)
        ]
        return {"objectness": self.head(torch.stack(smoothed).sum(dim=0))}


def make_network(settings: Settings) -> PyramidSegmenter:
    """Return a network whose backbone has the weights of a file, if the settings name one.

    Raises:
        SettingsError: the file is no state dict of this ResNet.
    """
    network = PyramidSegmenter(settings)
    if settings.backbone_weights:
        load_backbone(network.backbone, settings.backbone_weights)
    return network


def load_backbone(backbone: nn.Module, path: str) -> None:
    """Load a ResNet's weights from a state dict with torchvision's names; its classifier is left.

    Raises:
        SettingsError: the file is missing, is no state dict, or fits another network.
    """
    where = f"network.backbone_weights={path}"
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise SettingsError(f"{where}: there is no such file") from error
    except (OSError, RuntimeError, EOFError, ValueError, KeyError, UnpicklingError) as error:
        raise SettingsError(
            f"{where}: not a file of weights ({type(error).__name__}): give a state dict saved "
            "with torch.save"
        ) from error
    if not isinstance(state, dict):
        raise SettingsError(f"{where}: holds a {type(state).__name__}, not a state dict")
    wanted = backbone.state_dict()
    found = {name: value for name, value in state.items() if not name.startswith("fc.")}
    wrong = sorted(
        name
        for name in wanted.keys() | found.keys()
        if getattr(wanted.get(name), "shape", None) != getattr(found.get(name), "shape", None)
        and not name.endswith("num_batches_tracked")
    )
    if wrong:
        raise SettingsError(
            f"{where}: does not fit this ResNet: {len(wrong)} entries differ, first {wrong[0]}; "
            "set network.depth to the file's"
        )
    backbone.load_state_dict(found, strict=False)
