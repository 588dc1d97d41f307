"""Detectors: inputs, targets, losses and boxes fit together."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tcrdata import registry
from tcrdata.networks.center_targets import LabelBoxes, TargetSettings, center_targets
from tcrdata.networks.decoding import DecodeSettings, decode
from tcrdata.networks.grids import HeightSlices, Region, Sweep, birds_eye_image, voxel_image
from tcrdata.networks.losses import detection_losses

DETECTORS = [
    name
    for name in registry.names("networks")
    if registry.find("networks", name).KIND == "detector"
]
SMALL = {
    "birds_eye": {"lateral_m": "8", "far_m": "16", "widths": "16,24,24"},
    "release_birds_eye": {"lateral_m": "8", "far_m": "18", "stem": "16", "widths": "16,16,16,16"},
    "volume": {"lateral_m": "8", "far_m": "18", "widths": "8,8,8", "cell_m": "0.5", "layers": "8"},
}
REGION = Region(8.0, 0.0, 16.0, 0.5)


def labels_of(*boxes: list[float], positive: bool = True) -> LabelBoxes:
    count = len(boxes)
    return LabelBoxes(
        np.array(boxes, dtype=np.float64).reshape(-1, 7),
        np.full(count, positive),
        np.ones(count, bool),
    )


CAR = [1.3, 0.9, 9.1, 4.2, 1.8, 1.5, 0.5]
VAN = [-4.6, 0.8, 6.3, 5.0, 2.0, 2.0, -2.1]


def sweep_of(*points: tuple[float, float, float]) -> Sweep:
    xyz = np.array(points, dtype=np.float32).reshape(-1, 3)
    height = np.float32(1.7) - xyz[:, 1]
    return Sweep(xyz, height, height < 0.1, np.full((len(xyz), 3), 0.5, np.float32))


def outputs_that_say(targets: dict[str, np.ndarray]) -> dict[str, torch.Tensor]:
    """Raw outputs of a network that has learnt the targets by heart."""
    raw = {
        name: torch.from_numpy(targets[name].astype(np.float32))[None]
        for name in ("offset", "log_size", "axis", "direction")
    }
    heat = torch.from_numpy(targets["center"])[None].clamp(1e-4, 1 - 1e-4)
    return {**raw, "center": torch.logit(heat)}


def test_a_frame_from_above_shows_where_points_stand_and_how_high() -> None:
    sweep = sweep_of((0.1, 0.75, 5.1), (0.1, 1.65, 5.1), (3.0, 1.7, 8.0))
    image = birds_eye_image(sweep, REGION, HeightSlices(4, 0.25, 0.0))
    assert image.shape == (8, 32, 32)
    row, column = 10, 16
    assert image[3, row, column] == 1.0, "0.95 m above the ground"
    assert image[4, row, column] == pytest.approx(np.log1p(1) / 4), "the ground point is no part"
    assert image[5, row, column] == pytest.approx(0.95 / 4)
    assert image[6].sum() == 2, "both cells were observed"
    assert image[:4].sum() == 1


def test_points_without_a_height_count_as_observed_alone() -> None:
    sweep = sweep_of((0.1, 0.75, 5.1))
    unknown = Sweep(sweep.xyz, np.full(1, np.nan, np.float32), sweep.ground, sweep.colours)
    image = birds_eye_image(unknown, REGION, HeightSlices())
    assert np.isfinite(image).all()
    assert image[:14].sum() == 0
    assert image[14].sum() == 1


def test_voxels_hold_the_mean_colour() -> None:
    xyz = np.array([[0.1, 0.1, 0.1], [0.2, 0.2, 0.2]])
    image = voxel_image(xyz, np.array([[0.2], [0.6]]), REGION, 0.0, 0.5, 4)
    assert image.shape == (2, 4, 32, 32)
    assert image[0].sum() == 1
    assert image[1, 0, 0, 16] == pytest.approx(0.4)


def test_decoding_undoes_the_targets_to_the_offset() -> None:
    known = np.ones((32, 32), bool)
    targets = center_targets(labels_of(CAR, VAN), REGION, known, TargetSettings())
    (found,) = decode(outputs_that_say(targets), REGION, DecodeSettings())
    order = np.argsort(found.boxes[:, 0])
    for box, truth in zip(found.boxes[order], (VAN, CAR), strict=True):
        assert np.isnan(box[1])
        assert box[[0, 2, 3, 4, 5]] == pytest.approx(np.array(truth)[[0, 2, 3, 4, 5]], abs=1e-4)
        assert np.cos(box[6] - truth[6]) == pytest.approx(1.0, abs=1e-6)


def test_decoding_without_the_offset_would_miss_the_centre() -> None:
    targets = center_targets(labels_of(CAR), REGION, np.ones((32, 32), bool), TargetSettings())
    outputs = outputs_that_say(targets)
    outputs["offset"] = torch.zeros_like(outputs["offset"])
    (found,) = decode(outputs, REGION, DecodeSettings())
    assert abs(found.boxes[0, 0] - CAR[0]) > 0.01


def test_of_boxes_on_one_spot_the_surer_stays() -> None:
    targets = center_targets(labels_of(CAR), REGION, np.ones((32, 32), bool), TargetSettings())
    outputs = outputs_that_say(targets)
    outputs["center"][0, 0, 20, 18] = 2.0
    (found,) = decode(outputs, REGION, DecodeSettings())
    assert len(found.boxes) == 1
    assert found.scores[0] > 0.99


def test_what_is_neither_labelled_nor_known_teaches_nothing() -> None:
    known = np.zeros((32, 32), bool)
    known[:4] = True
    targets = center_targets(labels_of(CAR), REGION, known, TargetSettings())
    weight = targets["center_weight"][0]
    assert weight[:4].all()
    assert weight[18, 18] == 1.0, "a label is known"
    assert weight[30, 2] == 0.0
    assert not targets["box_weight"][0][30].any()


def test_what_is_to_be_ignored_teaches_nothing_either() -> None:
    known = np.ones((32, 32), bool)
    targets = center_targets(labels_of(CAR, positive=False), REGION, known, TargetSettings())
    assert targets["center"].max() == 0.0
    assert targets["center_weight"][0, 18, 18] == 0.0
    assert targets["center_weight"][0, 2, 2] == 1.0


def test_a_label_whose_heading_is_unknown_teaches_no_direction() -> None:
    car = labels_of(CAR)
    still = LabelBoxes(car.boxes, car.positive, np.zeros(1, bool))
    targets = center_targets(still, REGION, np.ones((32, 32), bool), TargetSettings())
    assert targets["box_weight"].max() == 1.0
    assert targets["direction_weight"].max() == 0.0


@pytest.mark.parametrize("name", DETECTORS)
def test_a_detector_learns_one_frame_by_heart(name: str) -> None:
    from tcrdata.settings import overridden

    module = registry.find("networks", name)
    settings = overridden(module.Settings(), SMALL[name], "network")
    torch.manual_seed(0)
    torch.set_num_threads(1)
    network = module.make_network(settings)
    corners = [(CAR[0] + dx, 0.5, CAR[2] + dz) for dx in (-1, 0, 1) for dz in (-1, 0, 1)]
    image = torch.from_numpy(module.image_of(sweep_of(*corners), settings))[None]
    stride = settings.stride
    known = np.ones((settings.region.rows // stride, settings.region.columns // stride), bool)
    made = module.targets_of(labels_of(CAR), known, settings, TargetSettings())
    targets = {key: torch.from_numpy(value)[None] for key, value in made.items()}
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3)
    losses = []
    for _ in range(30):
        terms = detection_losses(network(image), targets)
        loss = torch.stack(list(terms.values())).sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0]
    outputs = network(image)
    region = settings.region.coarser(stride)
    (found,) = decode(outputs, region, DecodeSettings(), settings.volume_top_m)
    assert len(found.boxes) >= 1
    assert np.hypot(*(found.boxes[0, [0, 2]] - np.array(CAR)[[0, 2]])) < 1.0


def test_the_variants_are_the_ones_described() -> None:
    assert DETECTORS == ["birds_eye", "release_birds_eye", "volume"]
    release = registry.find("networks", "release_birds_eye")
    outputs = release.make_network(release.Settings(stem=8, widths=(8, 8, 8, 8)))
    assert outputs.heads.heads["segmentation"][-1].out_channels == 4
    volume = registry.find("networks", "volume")
    heads = volume.make_network(volume.Settings(widths=(4, 4))).heads.heads
    assert [heads[n][-1].out_channels for n in ("center", "log_size", "offset", "heading")] == [
        1, 3, 3, 16,
    ]  # fmt: skip


def test_the_default_is_small() -> None:
    module = registry.find("networks", "birds_eye")
    network = module.make_network(module.Settings())
    count = sum(parameter.numel() for parameter in network.parameters())
    assert 300_000 < count < 500_000
