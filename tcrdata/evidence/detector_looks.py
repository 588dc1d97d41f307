"""What a trained detector says of a frame: of each of several looks at it, and of all together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tcrdata.evidence.objectness_boxes import footprint_heat
from tcrdata.types import FloatArray

if TYPE_CHECKING:
    import torch

    from tcrdata.networks.decoding import DecodeSettings, Detections
    from tcrdata.networks.grids import Sweep
    from tcrdata.networks.trained import Trained


def looked(
    trained: Trained,
    sweep: Sweep,
    known: FloatArray,
    peaks: DecodeSettings,
    *,
    mirrored: bool,
    turn_rad: float,
    fused_iou: float,
) -> tuple[Detections, list[float | None]]:
    """Return the boxes that a detector sees, and the largest heat in the footprint of others.

    Args:
        trained: the detector.
        sweep: what it looks at.
        known: (N, 7) boxes to say the heat of, metres of a road scene.
        peaks: how heat becomes boxes.
        mirrored: whether each look is the mean with one at its mirror image.
        turn_rad: it looks twice more, at the sweep turned so much either way; 0 for once.
        fused_iou: boxes of several looks that overlap more are one object's.

    Returns:
        the boxes, and a heat for each known box: the mean of the looks that cover it, None where
        the straight one does not.
    """
    from tcrdata.networks.decoding import Detections, decode
    from tcrdata.networks.fusion import fused, turned_boxes, turned_points

    region = trained.settings.region.coarser(trained.settings.stride)
    turns = (0.0, turn_rad, -turn_rad) if turn_rad else (0.0,)
    looks, heats = [], []
    for turn in turns:
        turned = replace(sweep, xyz=turned_points(sweep.xyz, turn)) if turn else sweep
        outputs = _outputs(trained, turned, mirrored)
        (found,) = decode(outputs, region, peaks, trained.settings.volume_top_m)
        looks.append(Detections(turned_boxes(found.boxes, -turn), found.scores))
        heats.append(footprint_heat(_heat(outputs), turned_boxes(known, turn), region))
    confidences = [
        None if said[0] is None else float(np.mean([heat for heat in said if heat is not None]))
        for said in zip(*heats, strict=True)
    ]
    return fused(looks, turns, region, fused_iou) if turn_rad else looks[0], confidences


def _outputs(trained: Trained, sweep: Sweep, mirrored: bool) -> Mapping[str, torch.Tensor]:
    """Return what the network says of a sweep, or the mean with its word on the mirror image."""
    import torch

    from tcrdata.networks.mirrored import mirrored_mean

    image = torch.from_numpy(trained.module.image_of(sweep, trained.settings))[None]
    with torch.inference_mode():
        if mirrored:
            return mirrored_mean(trained.network, image)
        outputs: Mapping[str, torch.Tensor] = trained.network(image)
        return outputs


def _heat(outputs: Mapping[str, torch.Tensor]) -> FloatArray:
    """Return (rows, columns): the probability of a centre, of a volume the largest above a cell."""
    import torch

    heat = torch.sigmoid(outputs["center"])[0]
    return np.asarray(heat.amax(dim=tuple(range(heat.ndim - 2))).numpy())
