"""Losses: every one is a mean over what is labelled, and silent about what is unknown."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch.nn import functional

TERM_WEIGHTS = {
    "center": 1.0,
    "offset": 0.5,
    "log_size": 1.0,
    "axis": 1.0,
    "direction": 0.2,
    "heading": 0.5,
    "segmentation": 1.0,
}
"""What each output counts in the sum."""


def masked_logistic(logits: torch.Tensor, target: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the masked logistic loss, eq. 8: mean over the mask of log(1 + exp(-s_hat s)).

    Args:
        logits: scores s, any shape.
        target: 1 for objects, 0 for background (s_hat = 2 target - 1); the same shape.
        mask: 1 where the target is known; the same shape.
    """
    losses = functional.softplus((1 - 2 * target) * logits)
    return (losses * mask).sum() / mask.sum().clamp(min=1.0)


def center_loss(logits: torch.Tensor, heat: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return CenterNet's penalty-reduced focal loss, over the known cells.

    Args:
        logits: (B, 1, ...).
        heat: (B, 1, ...) in [0, 1]; 1 in the cell of a centre.
        weight: (B, 1, ...) 1 where it is known, 0 elsewhere.
    """
    probability = torch.sigmoid(logits)
    peak = (heat >= 1.0).to(logits.dtype)
    found = peak * (1 - probability) ** 2 * functional.softplus(-logits)
    spurious = (1 - peak) * (1 - heat) ** 4 * probability**2 * functional.softplus(logits)
    return ((found + spurious) * weight).sum() / peak.sum().clamp(min=1.0)


def weighted_l1(output: torch.Tensor, target: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return the weighted mean of |output - target|; (B, C, ...) with weights (B, 1, ...)."""
    return ((output - target).abs() * weight).sum() / weight.sum().clamp(min=1e-3)


def heading_loss(logits: torch.Tensor, bins: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return the weighted cross entropy of (B, bins, ...) logits with (B, 1, ...) bin numbers."""
    losses = functional.cross_entropy(logits, bins[:, 0].long(), reduction="none")
    return (losses * weight[:, 0]).sum() / weight.sum().clamp(min=1e-3)


def detection_losses(
    outputs: Mapping[str, torch.Tensor], targets: Mapping[str, torch.Tensor]
) -> dict[str, torch.Tensor]:
    """Return each output's loss, weighted, so that their sum is what a detector learns from.

    Args:
        outputs: of a detector.
        targets: of `center_targets` and `segmentation_targets`, with a batch dimension.
    """
    box, moving = targets["box_weight"], targets["direction_weight"]
    losses = {}
    for name, output in outputs.items():
        target = targets[name]
        if name == "center":
            value = center_loss(output, target, targets["center_weight"])
        elif name == "segmentation":
            value = masked_logistic(output, target, targets["segmentation_weight"])
        elif name == "heading":
            value = heading_loss(output, target, box)
        else:
            value = weighted_l1(output, target, moving if name == "direction" else box)
        losses[name] = TERM_WEIGHTS[name] * value
    return losses


def objectness_losses(
    outputs: Mapping[str, torch.Tensor], targets: Mapping[str, torch.Tensor]
) -> dict[str, torch.Tensor]:
    """Return a segmenter's loss: eq. 8 over the pixels that are labelled.

    Args:
        outputs: `objectness`, (B, 1, H, W) logits.
        targets: `objectness` and `objectness_weight`, the same shape.
    """
    loss = masked_logistic(
        outputs["objectness"], targets["objectness"], targets["objectness_weight"]
    )
    return {"objectness": loss}


OBJECTIVES = {"detector": detection_losses, "segmenter": objectness_losses}
"""What each kind of network learns from."""
