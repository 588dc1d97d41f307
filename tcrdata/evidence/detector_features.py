"""What a trained detector's last features say at each point: what templates are correlated in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tcrdata.evidence.models import Model, network_of
from tcrdata.evidence.objectness3d import EVIDENCE
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching
from tcrdata.types import Float32Array, Frame, ImageArray, PointCloud


def detector_features(
    model: Model,
    frame: Frame,
    cloud: PointCloud,
    evidence: Mapping[str, EncodedPoints],
    metric_scale: float,
    image: ImageArray | None = None,
) -> Float32Array | None:
    """Return (N, C) features at the points of a frame; zeros outside of the detector's region.

    They are what the heads get: a map from above, or a volume whose layers' largest is taken.

    Args:
        model: a detector.
        frame: where the points were seen.
        cloud: the points.
        evidence: `EVIDENCE` of the frame, encoded; None comes back where something is missing.
        metric_scale: of the sequence.
        image: for networks that want colours.
    """
    if any(name not in evidence for name in EVIDENCE):
        return None
    import torch

    from tcrdata.networks.grids import Sweep, pixel_colours

    torch.set_num_threads(1)
    trained = network_of(model)
    known = {name: decode_matching(evidence[name], len(cloud)) for name in EVIDENCE}
    scale = np.float32(metric_scale)
    colours = pixel_colours(image, frame, cloud.xyz)
    sweep = Sweep(cloud.xyz / scale, known["height_m"] / scale, known["ground"], colours)
    caught: list[Any] = []
    hook = trained.network.heads.register_forward_pre_hook(
        lambda _, inputs: caught.append(inputs[0])
    )
    try:
        with torch.inference_mode():
            trained.network(
                torch.from_numpy(trained.module.image_of(sweep, trained.settings))[None]
            )
    finally:
        hook.remove()
    features = caught[0][0]
    if features.ndim > 3:
        features = features.amax(dim=tuple(range(1, features.ndim - 2)))
    region = trained.settings.region.coarser(trained.settings.stride)
    cells, inside = region.cells(sweep.xyz[:, 0], sweep.xyz[:, 2])
    flat = features.reshape(len(features), -1).numpy().T
    return np.ascontiguousarray(np.where(inside[:, None], flat[cells], 0.0), dtype=np.float32)
