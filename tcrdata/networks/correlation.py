"""All-pairs correlation of two feature maps, and its values around where a flow points."""

from __future__ import annotations

import torch
from torch.nn import functional

LEVELS = 4
LARGEST_VOLUME_BYTES = 2**30
"""Correlations of all with all are kept up to here; beyond, each look makes those that it needs."""

CHUNK_BYTES = 2**26
"""What a look that makes its own correlations gathers at once."""


class CorrelationPyramid:
    """Correlations of each position of one map with all of another, at four resolutions.

    `c(p, q) = <f1(p), f2(q)> / sqrt(channels)`. Averaging over q commutes with the product, so
    that each level is a product with averaged features. All of them grow with the square of the
    pixels: for large images none is kept, and looks cost more time instead.
    """

    def __init__(
        self,
        first: torch.Tensor,
        second: torch.Tensor,
        radius: int,
        largest_bytes: int = LARGEST_VOLUME_BYTES,
    ) -> None:
        """Correlate (B, C, H, W) feature maps; H and W at least 8.

        Args:
            first: of the image the flow starts from.
            second: of the one it points into.
            radius: cells around the flow's end that a look returns, at each level.
            largest_bytes: of correlations that may be kept.
        """
        batch, channels, height, width = first.shape
        self._radius = radius
        self._rows = first.flatten(2).transpose(1, 2) / channels**0.5
        self._maps = [second]
        for _ in range(1, LEVELS):
            self._maps.append(functional.avg_pool2d(self._maps[-1], 2))
        cells = sum(own.shape[-2] * own.shape[-1] for own in self._maps)
        self._volumes: list[torch.Tensor] | None = None
        if batch * height * width * cells * first.element_size() <= largest_bytes:
            self._volumes = [
                torch.bmm(self._rows, own.flatten(2)).view(-1, *own.shape[-2:])
                for own in self._maps
            ]

    def look(self, ends: torch.Tensor) -> torch.Tensor:
        """Return (B, LEVELS (2 radius + 1)^2, H, W) correlations, bilinear, 0 outside.

        Args:
            ends: (B, 2, H, W), where the flow points to, (column, row) in cells.
        """
        batch, _, height, width = ends.shape
        centers = ends.permute(0, 2, 3, 1).reshape(-1, 2)
        found = [self._level(level, centers / 2**level) for level in range(LEVELS)]
        together = torch.cat(found, dim=1).view(batch, height, width, -1)
        return together.permute(0, 3, 1, 2)

    def _level(self, level: int, centers: torch.Tensor) -> torch.Tensor:
        """(P, (2 radius + 1)^2) correlations of one level around (P, 2) centres."""
        height, width = self._maps[level].shape[-2:]
        window = _Window(centers, self._radius, height, width)
        if self._volumes is not None:
            volume = self._volumes[level].flatten(1)
            return window.blended(volume.gather(1, window.index.flatten(1)))
        return window.blended(self._made(level, window.index.flatten(1)))

    def _made(self, level: int, index: torch.Tensor) -> torch.Tensor:
        """(P, N) correlations of each position with the cells of an index, a few at a time."""
        batch, positions, channels = self._rows.shape
        item = self._rows.element_size() * channels * index.shape[1]
        found = []
        for number in range(batch):
            features = self._maps[level][number].flatten(1).t().contiguous()
            own = index[number * positions : (number + 1) * positions]
            size = max(CHUNK_BYTES // item, 1)
            for rows, part in zip(self._rows[number].split(size), own.split(size), strict=True):
                cells = features[part.flatten()].view(*part.shape, channels)
                found.append(torch.bmm(cells, rows.unsqueeze(2)).squeeze(2))
        return torch.cat(found)


class _Window:
    """Whole cells around (P, 2) centres in planes of a height and width, and how they are blended.

    All samples of a window lie at one fraction between cells: a window of whole cells is gathered
    once and blended. The column changes slowest, as in the published networks.
    """

    def __init__(self, centers: torch.Tensor, radius: int, height: int, width: int) -> None:
        floor = torch.floor(centers)
        self._blend = (centers - floor).unsqueeze(-1).unsqueeze(-1)
        steps = torch.arange(-radius, radius + 2, device=centers.device)
        # Flows far outside would overflow the integers.
        whole = floor.clamp(-(2.0**30), 2.0**30).long()
        columns, rows = whole[:, :1] + steps, whole[:, 1:] + steps
        self._inside = ((columns >= 0) & (columns < width)).unsqueeze(2) & (
            (rows >= 0) & (rows < height)
        ).unsqueeze(1)
        columns, rows = columns.clamp(0, width - 1), rows.clamp(0, height - 1)
        self.index = columns.unsqueeze(2) + rows.unsqueeze(1) * width

    def blended(self, cells: torch.Tensor) -> torch.Tensor:
        """(P, (2 radius + 2)^2) values of the cells to (P, (2 radius + 1)^2) samples."""
        cells = cells.view(self.index.shape) * self._inside
        cells = torch.lerp(cells[:, :-1], cells[:, 1:], self._blend[:, 0])
        return torch.lerp(cells[:, :, :-1], cells[:, :, 1:], self._blend[:, 1]).flatten(1)
