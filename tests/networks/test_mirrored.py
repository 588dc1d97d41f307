"""What a network says of a mirror image comes back as what it says of the scene."""

from __future__ import annotations

import numpy as np
import torch

from tcrdata.networks.center_targets import LabelBoxes, TargetSettings, center_targets
from tcrdata.networks.decoding import DecodeSettings, decode
from tcrdata.networks.grids import Region
from tcrdata.networks.mirrored import mirrored_mean, unmirrored

REGION = Region(8.0, 0.0, 16.0, 0.5)
CAR = np.array([2.3, 0.9, 9.1, 4.2, 1.8, 1.5, 0.5])
NAMES = ("offset", "log_size", "axis", "direction")


def outputs_for(box: np.ndarray) -> dict[str, torch.Tensor]:
    """Raw outputs that say exactly one box."""
    labels = LabelBoxes(box[None], np.ones(1, bool), np.ones(1, bool))
    known = np.ones((REGION.rows, REGION.columns), bool)
    targets = center_targets(labels, REGION, known, TargetSettings())
    raw = {name: torch.from_numpy(targets[name].astype(np.float32))[None] for name in NAMES}
    heat = torch.from_numpy(targets["center"])[None].clamp(1e-4, 1 - 1e-4)
    return {**raw, "center": torch.logit(heat)}


def mirrored(box: np.ndarray) -> np.ndarray:
    other = box.copy()
    other[0], other[6] = -box[0], np.pi - box[6]
    return other


def test_a_box_of_the_mirror_image_comes_back_where_it_is() -> None:
    (found,) = decode(unmirrored(outputs_for(mirrored(CAR))), REGION, DecodeSettings())
    known = [0, 2, 3, 4, 5, 6]
    assert np.allclose(found.boxes[0][known], CAR[known], atol=1e-4)


def test_the_mean_is_of_probabilities() -> None:
    straight, other = outputs_for(CAR), outputs_for(mirrored(CAR))
    answers = iter([straight, {**other, "center": torch.full_like(other["center"], -9.0)}])
    mean = mirrored_mean(lambda _: next(answers), torch.zeros(1, 1, 4, 4))
    assert float(torch.sigmoid(mean["center"]).max()) == float(
        (torch.sigmoid(straight["center"]).max() + torch.sigmoid(torch.tensor(-9.0))) / 2
    )


def test_outputs_keep_their_type() -> None:
    halves = {name: output.half() for name, output in outputs_for(CAR).items()}
    assert {output.dtype for output in unmirrored(halves).values()} == {torch.float16}


def test_bins_of_heading_turn_round() -> None:
    bins = torch.zeros(1, 16, 2, 2, 3)
    bins[0, 1, 0, 0, 0] = 5.0
    outputs = {"center": bins[:, :1], "offset": torch.ones(1, 3, 2, 2, 3), "heading": bins}
    back = unmirrored(outputs)
    assert back["heading"].argmax(dim=1)[0, 0, 0, 2] == 6, "1.5 bins from 0 are 6.5 from pi"
    assert back["offset"][0, :, 0, 0, 0].tolist() == [-1.0, 1.0, 1.0]
