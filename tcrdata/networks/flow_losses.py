"""Losses of optical flow: against what is known, against images, and against a teacher.

All sum over the iterations of RAFT, a later one counting more: `sum_k decay^(K - 1 - k) loss_k`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch.nn import functional

from tcrdata.errors import SettingsError
from tcrdata.networks.raft import STRIDE

SELF_SUPERVISED = ("photometric", "teacher", "occlusion")
"""What can be learnt without truth, one by one or together."""

WHOLE = 0.999
"""Least share of the four pixels around a point that have to be of the image."""


@dataclass(frozen=True)
class FlowLossSettings:
    """What counts how much.

    Attributes:
        decay: of an iteration's weight to that of the next one.
        exponent: alpha of the generalised Charbonnier penalty.
        epsilon: of it; colours are in [0, 1], flows in pixels.
        smoothness: weight of the smoothness beside the photometric loss.
        edge: how much a step in colour lets the flow step.
        photometric: weight; 0 leaves it out.
        teacher: weight of what the teacher says of its consistent pixels: its losses are of pixels,
            the photometric one of colours in [0, 1].
        occlusion: weight of what it says where the student sees nothing.
        unseen: weight of what it says where the student's own flow is not consistent, so that the
            images say nothing: beside the photometric loss alone, whose smoothness flattens that.
        cycle_share: alpha 1 of the cycle test.
        cycle_slack_px: alpha 2 of it, px^2.
    """

    decay: float = 0.8
    exponent: float = 0.45
    epsilon: float = 1e-3
    smoothness: float = 0.02
    edge: float = 10.0
    photometric: float = 1.0
    teacher: float = 0.002
    occlusion: float = 0.002
    unseen: float = 0.002
    cycle_share: float = 0.05
    cycle_slack_px: float = 0.5

    def __post_init__(self) -> None:
        for name in ("exponent", "epsilon"):
            if not 0 < getattr(self, name) < math.inf:
                raise SettingsError(f"losses.{name}: above 0, and finite")
        weights = (*SELF_SUPERVISED, "smoothness", "unseen")
        for name in (*weights, "decay", "edge", "cycle_share", "cycle_slack_px"):
            if not 0 <= getattr(self, name) < math.inf:
                what = "a weight of " if name in weights else ""
                raise SettingsError(f"losses.{name}: {what}0 or more is needed")
        if not any(getattr(self, name) > 0 for name in SELF_SUPERVISED):
            raise SettingsError(f"no loss is left: give one of {', '.join(SELF_SUPERVISED)}")


@dataclass(frozen=True)
class KnownLossSettings:
    """What counts how much where flow is known.

    Attributes:
        decay: of an iteration's weight to that of the next one.
        matching: weight of the features' own loss; 0 leaves it out.
        sharpness: of it: how much a correlation has to stand out.
    """

    decay: float = 0.8
    matching: float = 5.0
    sharpness: float = 5.0


def charbonnier(value: torch.Tensor, own: FlowLossSettings) -> torch.Tensor:
    """Return the generalised Charbonnier penalty `(x^2 + epsilon^2)^alpha`."""
    return (value * value + own.epsilon**2) ** own.exponent


def sample(image: torch.Tensor, flow: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return (B, C, H, W) at p + flow(p), bilinear, and (B, 1, H, W): 1 where that lies inside.

    Args:
        image: (B, C, H + 2 m, W + 2 m): with a margin around what the flow is of, or none.
        flow: (B, 2, H, W), px (column, row).
    """
    height, width = image.shape[-2:]
    margin = (height - flow.shape[-2]) // 2
    rows, columns = torch.meshgrid(
        torch.arange(flow.shape[-2], device=flow.device, dtype=flow.dtype),
        torch.arange(flow.shape[-1], device=flow.device, dtype=flow.dtype),
        indexing="ij",
    )
    x, y = columns + margin + flow[:, 0], rows + margin + flow[:, 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    ends = torch.stack([(2 * x + 1) / width - 1, (2 * y + 1) / height - 1], dim=-1)
    found = functional.grid_sample(image, ends, align_corners=False, padding_mode="border")
    return found, inside.unsqueeze(1).to(image.dtype)


def cycle_consistent(flow: torch.Tensor, back: torch.Tensor, own: FlowLossSettings) -> torch.Tensor:
    """Return (B, 1, H, W): 1 where `|w + w''|^2 < alpha 1 (|w|^2 + |w''|^2) + alpha 2` (eq. 5).

    Args:
        flow: (B, 2, H, W) px.
        back: (B, 2, H, W) px, of the pair turned round.
        own: the alphas.
    """
    holds, inside = _cycle(flow, back, own)
    return holds * inside


def _cycle(
    flow: torch.Tensor, back: torch.Tensor, own: FlowLossSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """Where the cycle holds, wherever it ends, and where it ends inside."""
    returned, inside = sample(back, flow)
    squared = ((flow + returned) ** 2).sum(dim=1, keepdim=True)
    size = (flow**2 + returned**2).sum(dim=1, keepdim=True)
    return (squared < own.cycle_share * size + own.cycle_slack_px).to(flow.dtype), inside


def photometric_loss(
    flow: torch.Tensor,
    images: tuple[torch.Tensor, torch.Tensor],
    seen: torch.Tensor,
    own: FlowLossSettings,
) -> torch.Tensor:
    """Return the mean of `rho(I1(p) - I2(p + w(p)))` over the pixels that are seen (eq. 2).

    Args:
        flow: (B, 2, H, W) px.
        images: the first, (B, 3, H, W) in [0, 1]; the second with a margin, (B, 4, H + 2 m,
            W + 2 m), its last channel 1 where there is an image.
        seen: (B, 1, H, W): 0 where the second image hides the pixel.
        own: the penalty.
    """
    ends, inside = sample(images[1], flow)
    inside = inside * (ends[:, 3:].detach() > WHOLE)
    penalty = charbonnier(images[0] - ends[:, :3], own).mean(dim=1, keepdim=True)
    return _mean(penalty, seen * inside)


def seen_pixels(
    flow: torch.Tensor, back: torch.Tensor, trusted: torch.Tensor, own: FlowLossSettings
) -> torch.Tensor:
    """Return (B, 1, H, W): 1 where the cycle holds, or leaves the piece and a teacher's holds.

    Args:
        flow: (B, 2, H, W) px.
        back: (B, 2, H, W) px, of the pair turned round.
        trusted: (B, 1, H, W): 1 where the flow of a teacher, who sees more, is consistent.
        own: the alphas.
    """
    holds, inside = _cycle(flow, back, own)
    return holds * inside + (1 - inside) * trusted


def smoothness_loss(flow: torch.Tensor, image: torch.Tensor, own: FlowLossSettings) -> torch.Tensor:
    """Return the mean of `exp(-edge |dI|) rho(ddw)` over both directions (eq. 3, edge-aware).

    The second difference: the first would ask a road that is driven over to move as one.
    """
    total = flow.new_zeros(())
    for dim in (-1, -2):
        step = torch.diff(image, dim=dim).abs().mean(dim=1, keepdim=True)
        length = step.shape[dim]
        step = torch.maximum(step.narrow(dim, 0, length - 1), step.narrow(dim, 1, length - 1))
        bend = charbonnier(torch.diff(flow, n=2, dim=dim), own).sum(dim=1, keepdim=True)
        total = total + (torch.exp(-own.edge * step) * bend).mean()
    return total


def imitation_loss(
    flow: torch.Tensor, taught: torch.Tensor, mask: torch.Tensor, own: FlowLossSettings
) -> torch.Tensor:
    """Return the mean of `rho(w - w_teacher)` over a mask (B, 1, H, W)."""
    return _mean(charbonnier(flow - taught, own).sum(dim=1, keepdim=True), mask)


def matching_loss(
    features: torch.Tensor, flow: torch.Tensor, known: torch.Tensor, sharpness: float
) -> torch.Tensor:
    """Return the mean of `-log p(p + w(p) | p)`, p the softmax of a cell's correlations with all.

    It teaches features to find their own kind before anything can read flow from correlations.
    Ends between cells count their four neighbours by bilinear shares; ends outside are left out.

    Args:
        features: (B, 2, C, h, w) of both images, padded to whole cells of 8 px.
        flow: (B, 2, H, W) px, from the first to the second.
        known: (B, 1, H, W): 1 where flow is known; a cell with padding is left out.
        sharpness: factor of `<f1, f2> / sqrt(C)` before the softmax.
    """
    height, width = features.shape[-2:]
    first, second = (features[:, number].flatten(2) for number in (0, 1))
    scale = sharpness / features.shape[2] ** 0.5
    log_shares = torch.log_softmax(scale * first.transpose(1, 2) @ second, dim=2)
    across, down = STRIDE * width - flow.shape[-1], STRIDE * height - flow.shape[-2]
    margins = (across // 2, across - across // 2, down // 2, down - down // 2)
    flow, known = (functional.pad(values, margins) for values in (flow, known))
    moved = functional.avg_pool2d(flow, STRIDE) / STRIDE
    seen = (functional.avg_pool2d(known, STRIDE) == 1).flatten(1)
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    x = (columns.to(flow) + moved[:, 0]).flatten(1)
    y = (rows.to(flow) + moved[:, 1]).flatten(1)
    seen = seen & (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    left, above = x.floor().clamp(0, width - 2), y.floor().clamp(0, height - 2)
    total = torch.zeros_like(x)
    for right, below in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = (1 - (x - left - right).abs()) * (1 - (y - above - below).abs())
        cell = ((above + below) * width + left + right).long()
        total = total - share * log_shares.gather(2, cell.unsqueeze(2)).squeeze(2)
    return _mean(total, seen.to(flow.dtype))


def known_flow_losses(
    outputs: Mapping[str, torch.Tensor],
    batch: Mapping[str, torch.Tensor],
    own: KnownLossSettings,
) -> dict[str, torch.Tensor]:
    """Return the mean absolute error against flow that is known, and the loss of the features.

    Args:
        outputs: `flow`, (B V, K, 2, H, W), and `features` (B V, 2, C, h, w).
        batch: `flow` (B, V, 2, H, W) and `known` (B, V, 1, H, W), V views of each pair.
        own: weights.
    """
    truth, known = batch["flow"].flatten(0, 1), batch["known"].flatten(0, 1)
    error = (outputs["flow"] - truth.unsqueeze(1)).abs().sum(dim=2)
    by_iteration = (error * known).sum(dim=(0, 2, 3)) / known.sum().clamp(min=1)
    losses = {"known": (by_iteration * _shares(len(by_iteration), own.decay, error)).sum()}
    if own.matching > 0:
        matched = matching_loss(outputs["features"], truth, known, own.sharpness)
        losses["matching"] = own.matching * matched
    return losses


def self_supervised_losses(
    outputs: Mapping[str, torch.Tensor], batch: Mapping[str, torch.Tensor], own: FlowLossSettings
) -> dict[str, torch.Tensor]:
    """Return the losses that need no truth, each only where its weight is above 0.

    Args:
        outputs: `flow`, (2 B, K, 2, H, W): pair after pair, forward then backward.
        batch: `images` (B, 2, 4, H + 2 m, W + 2 m), not occluded, with a margin around the piece,
            last channel 1 where there is an image; `taught` (B, 2, 2, H, W) flow of the teacher,
            forward and backward; `trusted` (B, 2, 1, H, W), where it is cycle-consistent; `hidden`
            (B, 2, 1, H, W), where the student's input was occluded.
        own: weights and penalty.
    """
    second = batch["images"].flip(1).flatten(0, 1)
    taught, trusted, hidden = (batch[n].flatten(0, 1) for n in ("taught", "trusted", "hidden"))
    flows = outputs["flow"]
    margin = (second.shape[-1] - flows.shape[-1]) // 2
    whole = batch["images"].flatten(0, 1)[:, :3]
    first = functional.pad(whole, [-margin] * 4)
    shares = _shares(flows.shape[1], own.decay, flows)
    seen = None
    if own.photometric > 0:
        last = flows[:, -1].detach()
        back = last.view(-1, 2, *last.shape[1:]).flip(1).flatten(0, 1)
        seen = seen_pixels(last, back, trusted, own)
    totals: dict[str, torch.Tensor] = {}
    for number, share in enumerate(shares):
        flow = flows[:, number]
        parts = {}
        if seen is not None:
            parts["photometric"] = photometric_loss(flow, (first, second), seen, own)
            parts["smoothness"] = own.smoothness * smoothness_loss(flow, first, own)
            if own.unseen > 0:
                parts["unseen"] = imitation_loss(flow, taught, 1 - seen, own)
        if own.teacher > 0:
            parts["teacher"] = imitation_loss(flow, taught, trusted * (1 - hidden), own)
        if own.occlusion > 0:
            parts["occlusion"] = imitation_loss(flow, taught, trusted * hidden, own)
        for name, part in parts.items():
            weight = own.photometric if name == "smoothness" else getattr(own, name)
            totals[name] = totals.get(name, 0) + share * weight * part
    return totals


def _shares(iterations: int, decay: float, like: torch.Tensor) -> torch.Tensor:
    steps = torch.arange(iterations - 1, -1, -1, device=like.device, dtype=like.dtype)
    return decay**steps


def _mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    return (values * mask).sum() / mask.sum().clamp(min=1.0)
