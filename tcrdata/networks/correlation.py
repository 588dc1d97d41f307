"""All-pairs correlation of two feature maps, and its values around where a flow points."""

from __future__ import annotations

import torch
from torch.nn import functional

LEVELS = 4


class CorrelationPyramid:
    """Correlations of each position of one map with all of another, at four resolutions.

    `c(p, q) = <f1(p), f2(q)> / sqrt(channels)`. Averaging over q commutes with the product, so
    that each level is a product with averaged features.
    """

    def __init__(self, first: torch.Tensor, second: torch.Tensor, radius: int) -> None:
        """Correlate (B, C, H, W) feature maps; H and W at least 8.

        Args:
            first: of the image the flow starts from.
            second: of the one it points into.
            radius: cells around the flow's end that a look returns, at each level.
        """
        batch, channels, height, width = first.shape
        rows = first.flatten(2).transpose(1, 2) / channels**0.5
        self._radius = radius
        self._levels: list[torch.Tensor] = []
        for level in range(LEVELS):
            if level:
                second = functional.avg_pool2d(second, 2)
            volume = torch.bmm(rows, second.flatten(2))
            self._levels.append(volume.view(batch * height * width, *second.shape[-2:]))

    def look(self, ends: torch.Tensor) -> torch.Tensor:
        """Return (B, LEVELS (2 radius + 1)^2, H, W) correlations, bilinear, 0 outside.

        Args:
            ends: (B, 2, H, W), where the flow points to, (column, row) in cells.
        """
        batch, _, height, width = ends.shape
        centers = ends.permute(0, 2, 3, 1).reshape(-1, 2)
        found = [
            _window(volume, centers / 2**level, self._radius)
            for level, volume in enumerate(self._levels)
        ]
        together = torch.cat(found, dim=1).view(batch, height, width, -1)
        return together.permute(0, 3, 1, 2).contiguous()


def _window(volume: torch.Tensor, centers: torch.Tensor, radius: int) -> torch.Tensor:
    """Return (P, (2 radius + 1)^2) samples around (P, 2) centres of (P, H, W) planes.

    All samples of a window lie at one fraction between cells: a window of whole cells is gathered
    once and blended. The column changes slowest, as in the published networks.
    """
    positions, height, width = volume.shape
    floor = torch.floor(centers)
    blend = (centers - floor).unsqueeze(-1).unsqueeze(-1)
    steps = torch.arange(-radius, radius + 2, device=volume.device)
    # Flows far outside would overflow the integers.
    whole = floor.clamp(-(2.0**30), 2.0**30).long()
    columns, rows = whole[:, :1] + steps, whole[:, 1:] + steps
    inside = ((columns >= 0) & (columns < width)).unsqueeze(2) & (
        (rows >= 0) & (rows < height)
    ).unsqueeze(1)
    index = (
        columns.clamp(0, width - 1).unsqueeze(2) + rows.clamp(0, height - 1).unsqueeze(1) * width
    )
    cells = volume.view(positions, -1).gather(1, index.flatten(1)).view(index.shape)
    cells = cells * inside
    cells = torch.lerp(cells[:, :-1], cells[:, 1:], blend[:, 0])
    return torch.lerp(cells[:, :, :-1], cells[:, :, 1:], blend[:, 1]).flatten(1)
