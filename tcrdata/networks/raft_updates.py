"""How RAFT corrects a flow: correlations around where it points, through a recurrent unit.

What the recurrent unit makes of the context is the same in every iteration and computed once.
Parameters have the names and shapes of the published networks.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import nn
from torch.nn import functional

Terms = list[tuple[torch.Tensor, torch.Tensor]]


class SmallMotion(nn.Module):
    """Correlations and flow to 82 channels: 80 learnt, and the flow itself."""

    channels = 82

    def __init__(self, correlations: int) -> None:
        super().__init__()
        self.convc1 = nn.Conv2d(correlations, 96, 1)
        self.convf1 = nn.Conv2d(2, 64, 7, padding=3)
        self.convf2 = nn.Conv2d(64, 32, 3, padding=1)
        self.conv = nn.Conv2d(128, self.channels - 2, 3, padding=1)

    def forward(self, flow: torch.Tensor, correlation: torch.Tensor) -> torch.Tensor:
        """(B, 2, H, W) in cells and (B, correlations, H, W) to (B, channels, H, W)."""
        matched = torch.relu(self.convc1(correlation))
        moved = torch.relu(self.convf2(torch.relu(self.convf1(flow))))
        found = torch.relu(self.conv(torch.cat([matched, moved], dim=1)))
        return torch.cat([found, flow], dim=1)


class FullMotion(nn.Module):
    """Correlations and flow to 128 channels: 126 learnt, and the flow itself."""

    channels = 128

    def __init__(self, correlations: int) -> None:
        super().__init__()
        self.convc1 = nn.Conv2d(correlations, 256, 1)
        self.convc2 = nn.Conv2d(256, 192, 3, padding=1)
        self.convf1 = nn.Conv2d(2, 128, 7, padding=3)
        self.convf2 = nn.Conv2d(128, 64, 3, padding=1)
        self.conv = nn.Conv2d(256, self.channels - 2, 3, padding=1)

    def forward(self, flow: torch.Tensor, correlation: torch.Tensor) -> torch.Tensor:
        """(B, 2, H, W) in cells and (B, correlations, H, W) to (B, channels, H, W)."""
        matched = torch.relu(self.convc2(torch.relu(self.convc1(correlation))))
        moved = torch.relu(self.convf2(torch.relu(self.convf1(flow))))
        found = torch.relu(self.conv(torch.cat([matched, moved], dim=1)))
        return torch.cat([found, flow], dim=1)


class ConvGru(nn.Module):
    """A gated recurrent unit of convolutions, in one pass or several.

    `z, r = sigmoid(conv[h, x])`, `q = tanh(conv[r h, x])`, `h <- (1 - z) h + z q`, where x is the
    context followed by the motion.

    Args:
        hidden: channels of the state h.
        context: channels of the context.
        motion: channels of the motion.
        kernels: height and width of each pass's kernels, by the ending of its names.
    """

    def __init__(
        self, hidden: int, context: int, motion: int, kernels: Mapping[str, tuple[int, int]]
    ) -> None:
        super().__init__()
        self._hidden, self._context, self._kernels = hidden, context, dict(kernels)
        for ending, kernel in kernels.items():
            padding = (kernel[0] // 2, kernel[1] // 2)
            for gate in "zrq":
                convolution = nn.Conv2d(hidden + context + motion, hidden, kernel, padding=padding)
                self.add_module(f"conv{gate}{ending}", convolution)

    def context_terms(self, context: torch.Tensor) -> Terms:
        """Return what (B, context, H, W) adds to z and r, and to q, in each pass."""
        terms = []
        for ending, (height, width) in self._kernels.items():
            padding = (height // 2, width // 2)
            z, r, q = (getattr(self, f"conv{gate}{ending}") for gate in "zrq")
            weight, bias = torch.cat([z.weight, r.weight]), torch.cat([z.bias, r.bias])
            own = slice(self._hidden, self._hidden + self._context)
            gates = functional.conv2d(context, weight[:, own], bias, padding=padding)
            terms.append((gates, functional.conv2d(context, q.weight[:, own], q.bias, 1, padding)))
        return terms

    def forward(self, state: torch.Tensor, motion: torch.Tensor, terms: Terms) -> torch.Tensor:
        """Return the next state.

        Args:
            state: (B, hidden, H, W).
            motion: (B, motion, H, W).
            terms: of `context_terms`.
        """
        for (ending, (height, width)), (gates, proposal) in zip(
            self._kernels.items(), terms, strict=True
        ):
            padding = (height // 2, width // 2)
            z, r, q = (getattr(self, f"conv{gate}{ending}") for gate in "zrq")
            both = self._own(torch.cat([z.weight, r.weight]))
            seen = torch.cat([state, motion], dim=1)
            opened = torch.sigmoid(functional.conv2d(seen, both, padding=padding) + gates)
            update, reset = opened.chunk(2, dim=1)
            seen = torch.cat([reset * state, motion], dim=1)
            found = functional.conv2d(seen, self._own(q.weight), padding=padding) + proposal
            state = (1 - update) * state + update * torch.tanh(found)
        return state

    def _own(self, weight: torch.Tensor) -> torch.Tensor:
        """The weights of state and motion, without those of the context between them."""
        return torch.cat(
            [weight[:, : self._hidden], weight[:, self._hidden + self._context :]], dim=1
        )


class FlowHead(nn.Module):
    """The state to a correction of the flow, (B, 2, H, W) in cells of 8 px."""

    def __init__(self, hidden: int, width: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(hidden, width, 3, padding=1)
        self.conv2 = nn.Conv2d(width, 2, 3, padding=1)
        # What has learnt nothing yet says that nothing moves.
        nn.init.zeros_(self.conv2.weight)
        nn.init.zeros_(self.conv2.bias)

    def forward(self, state: torch.Tensor) -> torch.Tensor:
        """(B, hidden, H, W) to (B, 2, H, W)."""
        return self.conv2(torch.relu(self.conv1(state)))


class SmallUpdate(nn.Module):
    """One iteration of the small network."""

    def __init__(self, correlations: int, hidden: int, context: int) -> None:
        super().__init__()
        self.encoder = SmallMotion(correlations)
        self.gru = ConvGru(hidden, context, SmallMotion.channels, {"": (3, 3)})
        self.flow_head = FlowHead(hidden, 128)

    def upsampling(self, state: torch.Tensor) -> torch.Tensor | None:  # noqa: ARG002
        """Return nothing: the small network upsamples bilinearly."""
        return None


class FullUpdate(nn.Module):
    """One iteration of the full network."""

    def __init__(self, correlations: int, hidden: int, context: int) -> None:
        super().__init__()
        self.encoder = FullMotion(correlations)
        self.gru = ConvGru(hidden, context, FullMotion.channels, {"1": (1, 5), "2": (5, 1)})
        self.flow_head = FlowHead(hidden, 256)
        self.mask = nn.Sequential(
            nn.Conv2d(hidden, 256, 3, padding=1), nn.ReLU(), nn.Conv2d(256, 64 * 9, 1)
        )

    def upsampling(self, state: torch.Tensor) -> torch.Tensor | None:
        """Return logits of how each pixel mixes nine flows around it, (B, 576, H / 8, W / 8).

        A quarter of what the convolutions give, as published: it balances their gradients.
        """
        return 0.25 * self.mask(state)
