"""A detector's outputs back to boxes. Scores are kept as they are: rules decide what is enough."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from tcrdata.geometry.boxes import bev_iou
from tcrdata.networks.grids import Region
from tcrdata.types import FloatArray

NOT_BOXES = ("center", "segmentation")
"""Outputs that say nothing of a peak's box."""


@dataclass(frozen=True)
class DecodeSettings:
    """How peaks become boxes.

    Attributes:
        window: a peak is the largest in a square of so many cells; odd.
        most: at most so many a frame.
        least_score: what is fainter is noise, not a candidate.
        same_iou: of boxes that overlap more, from above, the surer one stays.
    """

    window: int = 3
    most: int = 64
    least_score: float = 0.05
    same_iou: float = 0.2


@dataclass(frozen=True)
class Detections:
    """Boxes of one frame, surest first.

    Attributes:
        boxes: (N, 7), level frame, metres of a road scene; y is NaN where the network sees from
            above and does not tell it.
        scores: (N,) in [0, 1].
    """

    boxes: FloatArray
    scores: FloatArray


@torch.no_grad()
def decode(
    outputs: Mapping[str, torch.Tensor],
    region: Region,
    settings: DecodeSettings,
    top_m: float | None = None,
) -> list[Detections]:
    """Return the boxes of each frame of a batch.

    A box stands at the middle of its cell plus the offset that the network gives for it.

    Args:
        outputs: raw outputs (B, channels, [layers,] rows, columns).
        region: the ground covered, in output cells.
        settings: how peaks become boxes.
        top_m: y of a volume's upper face; None for a map from above.
    """
    heat = torch.sigmoid(outputs["center"])
    pooled = _largest_around(heat, settings.window)
    peaks = torch.where(heat == pooled, heat, torch.zeros_like(heat))
    return [
        _decoded({name: o[i] for name, o in outputs.items()}, peaks[i, 0], region, settings, top_m)
        for i in range(len(heat))
    ]


def _largest_around(heat: torch.Tensor, window: int) -> torch.Tensor:
    if heat.ndim == 4:
        return functional.max_pool2d(heat, window, 1, window // 2)
    return functional.max_pool3d(heat, window, 1, window // 2)


def _decoded(
    outputs: Mapping[str, torch.Tensor],
    peaks: torch.Tensor,
    region: Region,
    settings: DecodeSettings,
    top_m: float | None,
) -> Detections:
    flat = peaks.flatten()
    scores, cells = flat.topk(min(settings.most, len(flat)))
    cells = cells[scores >= settings.least_score]
    values = {
        n: o.flatten(1)[:, cells].double().cpu().numpy()
        for n, o in outputs.items()
        if n not in NOT_BOXES
    }
    places = np.array(np.unravel_index(cells.cpu().numpy(), peaks.shape), dtype=np.float64)
    boxes = np.full((len(cells), 7), np.nan)
    offset = values["offset"]
    boxes[:, 0] = (places[-1] + 0.5 + offset[0]) * region.cell_m - region.lateral_m
    boxes[:, 2] = (places[-2] + 0.5 + offset[-1]) * region.cell_m + region.near_m
    if top_m is not None:
        boxes[:, 1] = (places[0] + 0.5 + offset[1]) * region.cell_m + top_m
    boxes[:, 3:6] = np.exp(np.clip(values["log_size"], -3.0, 3.0)).T
    boxes[:, 6] = _yaw(values)
    kept_scores = scores[scores >= settings.least_score].double().cpu().numpy()
    kept = _surest(boxes, settings.same_iou)
    return Detections(boxes[kept], kept_scores[kept])


def _yaw(values: Mapping[str, FloatArray]) -> FloatArray:
    """Return (N,) yaws: the bin's middle, or the axis turned to where it moves."""
    if "heading" in values:
        bins = len(values["heading"])
        return np.asarray((values["heading"].argmax(axis=0) + 0.5) * (2 * np.pi / bins))
    axis, direction = values["axis"], values["direction"]
    yaw = np.arctan2(axis[1], axis[0]) / 2
    backwards = direction[0] * np.cos(yaw) + direction[1] * np.sin(yaw) < 0
    return np.asarray(np.where(backwards, yaw + np.pi, yaw))


def _surest(boxes: FloatArray, same_iou: float) -> list[int]:
    """Return which of the boxes, surest first, no surer one covers."""
    overlap = bev_iou(boxes, boxes)
    kept: list[int] = []
    for number in range(len(boxes)):
        if not np.any(overlap[number, kept] > same_iou):
            kept.append(number)
    return kept
