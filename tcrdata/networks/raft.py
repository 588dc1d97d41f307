"""RAFT: optical flow by recurrent updates (Teed and Deng, ECCV 2020), small and full.

State dicts have the names and shapes of the published networks, so that their weights load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import nn
from torch.nn import functional

from tcrdata.errors import SettingsError
from tcrdata.networks.correlation import LEVELS, CorrelationPyramid
from tcrdata.networks.raft_encoders import Encoder
from tcrdata.networks.raft_updates import FullUpdate, SmallUpdate

KIND: Literal["flow"] = "flow"
STRIDE = 8
LEAST_CELLS = 8
"""The coarsest of four levels needs a cell."""

_FIRST_FEATURES = 0.3
"""Scale of features that have learnt nothing: with larger ones the first steps drive all units of
the flow head to where they never fire again."""


@dataclass(frozen=True)
class Settings:
    """The network's size and how long it looks.

    Attributes:
        size: small (1.0 M parameters) or full (5.3 M).
        iterations: corrections of the flow; more cost time in proportion.
        frozen_norms: batch norms keep their statistics in training: where batches are small.
        both_ways: flow from the second image to the first, too; features are made once.
    """

    size: str = "small"
    iterations: int = 12
    frozen_norms: bool = False
    both_ways: bool = False

    def __post_init__(self) -> None:
        if self.size not in SIZES:
            raise SettingsError(f"network.size: '{self.size}' is none of {', '.join(SIZES)}")
        if self.iterations < 1:
            raise SettingsError(f"network.iterations: {self.iterations}: at least one is needed")


@dataclass(frozen=True)
class _Size:
    hidden: int
    context: int
    features: int
    radius: int
    widths: tuple[int, int, int]
    bottleneck: bool


SIZES = {
    "small": _Size(96, 64, 128, 3, (32, 64, 96), True),
    "full": _Size(128, 128, 256, 4, (64, 96, 128), False),
}


class Raft(nn.Module):
    """Flow from a pair of images."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings
        self._size = size = SIZES[settings.size]
        norm: Literal["batch", "none"] = "batch" if settings.size == "full" else "none"
        both, bottleneck = size.hidden + size.context, size.bottleneck
        self.fnet = Encoder(size.widths, size.features, "instance", bottleneck=bottleneck)
        with torch.no_grad():
            self.fnet.conv2.weight.mul_(_FIRST_FEATURES)
        self.cnet = Encoder(size.widths, both, norm, bottleneck=bottleneck)
        correlations = LEVELS * (2 * size.radius + 1) ** 2
        update = FullUpdate if settings.size == "full" else SmallUpdate
        self.update_block: FullUpdate | SmallUpdate = update(
            correlations, size.hidden, size.context
        )

    def train(self, mode: bool = True) -> Raft:
        """Switch to training; batch norms stay as they are where the settings freeze them."""
        super().train(mode)
        if self.settings.frozen_norms:
            for module in self.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        return self

    def forward(self, pair: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return `flow` in pixels (column, row): of every iteration in training, else of the last.

        Args:
            pair: (B, 6, H, W), both images in [0, 1], RGB; any size. Or (B, V, 6, H, W): several
                views of each pair.

        Returns:
            `flow`: (B V, K, 2, H, W), or (2 B V, K, 2, H, W) both ways: forward and backward, pair
            by pair. In training `features`, too: (B V, 2, C, h, w) of both images, at an eighth of
            the size that is padded to whole cells.
        """
        height, width = pair.shape[-2:]
        pair = pair.reshape(-1, 6, height, width)
        left, right, top, bottom = _margins(height, width)
        padded = functional.pad(2 * pair - 1, (left, right, top, bottom), mode="replicate")
        flows, features = self._flows(padded)
        kept = torch.stack(flows if self.training else flows[-1:], dim=1)
        found = {"flow": kept[..., top : top + height, left : left + width]}
        return {**found, "features": features} if self.training else found

    def _flows(self, pair: torch.Tensor) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Flow after each iteration, at full size, and the features."""
        # Outside of training convolutions are faster with a position's channels side by side.
        layout = torch.contiguous_format if self.training else torch.channels_last
        images = pair.view(-1, 2, 3, *pair.shape[-2:])
        features = self.fnet(images.flatten(0, 1)).float()
        own = features.view(len(pair), 2, *features.shape[1:])
        if self.settings.both_ways:
            first, second = features, own.flip(1).flatten(0, 1)
            seen = self.cnet(images.flatten(0, 1).contiguous(memory_format=layout))
        else:
            first, second = own[:, 0], own[:, 1]
            seen = self.cnet(images[:, 0].contiguous(memory_format=layout))
        pyramid = CorrelationPyramid(first, second, self._size.radius)
        state, context = seen.split([self._size.hidden, self._size.context], dim=1)
        state, terms = torch.tanh(state), self.update_block.gru.context_terms(torch.relu(context))
        start = _grid(seen.shape[-2], seen.shape[-1], seen.device)
        ends = start.repeat(len(seen), 1, 1, 1).contiguous(memory_format=layout)
        flows = []
        for number in range(self.settings.iterations):
            ends = ends.detach()
            looked = pyramid.look(ends).contiguous(memory_format=layout)
            motion = self.update_block.encoder(ends - start, looked)
            state = self.update_block.gru(state, motion, terms)
            ends = ends + self.update_block.flow_head(state)
            if self.training or number == self.settings.iterations - 1:
                flows.append(_upsampled(ends - start, self.update_block.upsampling(state)))
        return flows, own


def make_network(settings: Settings) -> Raft:
    """Return a network with random weights; see `raft_weights` for those of a file."""
    return Raft(settings)


def _margins(height: int, width: int) -> tuple[int, int, int, int]:
    """Pixels to add left, right, above and below, so that whole cells cover the image."""
    margins = []
    for pixels in (width, height):
        cells = max(-(-pixels // STRIDE), LEAST_CELLS)
        extra = cells * STRIDE - pixels
        margins += [extra // 2, extra - extra // 2]
    return margins[0], margins[1], margins[2], margins[3]


def _grid(height: int, width: int, device: torch.device) -> torch.Tensor:
    """(1, 2, H, W): column and row of each cell."""
    rows, columns = torch.meshgrid(
        torch.arange(height, device=device, dtype=torch.float32),
        torch.arange(width, device=device, dtype=torch.float32),
        indexing="ij",
    )
    return torch.stack([columns, rows])[None]


def _upsampled(flow: torch.Tensor, logits: torch.Tensor | None) -> torch.Tensor:
    """(B, 2, H, W) in cells to (B, 2, 8 H, 8 W) in pixels: bilinear, or mixed as logits say."""
    batch, _, height, width = flow.shape
    if logits is None:
        size = (STRIDE * height, STRIDE * width)
        return STRIDE * functional.interpolate(flow, size, mode="bilinear", align_corners=True)
    shares = torch.softmax(logits.view(batch, 1, 9, STRIDE, STRIDE, height, width), dim=2)
    around = functional.unfold(STRIDE * flow, 3, padding=1).view(batch, 2, 9, 1, 1, height, width)
    mixed = (shares * around).sum(dim=2).permute(0, 1, 4, 2, 5, 3)
    return mixed.reshape(batch, 2, STRIDE * height, STRIDE * width)
