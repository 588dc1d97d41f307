from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tcrdata.errors import SettingsError
from tcrdata.networks.flow_losses import (
    FlowLossSettings,
    KnownLossSettings,
    charbonnier,
    cycle_consistent,
    imitation_loss,
    known_flow_losses,
    matching_loss,
    photometric_loss,
    seen_pixels,
    self_supervised_losses,
    smoothness_loss,
)

OWN = FlowLossSettings()
FLOOR = OWN.epsilon ** (2 * OWN.exponent)
EVERY = torch.ones((1, 1, 12, 16))


def constant(u: float, v: float) -> torch.Tensor:
    return torch.tensor([float(u), float(v)]).view(1, 2, 1, 1).expand(1, 2, 12, 16).clone()


def framed(image: torch.Tensor) -> torch.Tensor:
    """With a last channel that says that there is an image everywhere."""
    return torch.cat([image, torch.ones_like(image[:, :1])], dim=1)


@pytest.fixture(scope="module")
def images() -> tuple[torch.Tensor, torch.Tensor]:
    """The second is the first moved by (3, -2) px."""
    whole = torch.rand((1, 3, 30, 30), generator=torch.Generator().manual_seed(0))
    return whole[..., 8:20, 8:24], whole[..., 10:22, 5:21]


def test_the_penalty_is_that_of_eq_2() -> None:
    own = replace(OWN, exponent=0.5, epsilon=3.0)
    assert charbonnier(torch.tensor(4.0), own).item() == pytest.approx(5.0)


def test_the_right_flow_leaves_no_photometric_loss(
    images: tuple[torch.Tensor, torch.Tensor],
) -> None:
    both = images[0], framed(images[1])
    right = photometric_loss(constant(3, -2), both, EVERY, OWN)
    assert right.item() == pytest.approx(FLOOR, rel=0.01)
    assert photometric_loss(constant(0, 0), both, EVERY, OWN).item() > 50 * FLOOR


def test_what_leaves_the_piece_is_looked_up_around_it_where_there_is_an_image(
    images: tuple[torch.Tensor, torch.Tensor],
) -> None:
    around = torch.zeros((1, 4, 20, 24))
    around[..., 4:16, 4:20] = framed(images[1])
    leaving = EVERY.clone()
    leaving[..., 2:, :13] = 0

    def loss() -> float:
        return photometric_loss(constant(3, -2), (images[0], around), leaving, OWN).item()

    assert loss() == 0
    around[:, 3] = 1
    assert loss() > 50 * FLOOR


def test_a_teacher_who_sees_more_says_what_is_seen_beyond_the_piece() -> None:
    flow, back = constant(3, 0), constant(-3, 0)
    back[..., :8] = 9
    seen = seen_pixels(flow, back, EVERY, OWN)[0, 0]
    assert not seen[:, :5].any()
    assert seen[:, 5:].all()
    assert not seen_pixels(flow, back, 0 * EVERY, OWN)[0, 0, :, 13:].any()


def test_pixels_that_are_hidden_are_left_out(images: tuple[torch.Tensor, torch.Tensor]) -> None:
    seen = EVERY.clone()
    seen[..., 6:] = 0
    spoilt = images[1].clone()
    spoilt[..., 9:] = 0.5
    loss = photometric_loss(constant(3, -2), (images[0], framed(spoilt)), seen, OWN)
    assert loss.item() == pytest.approx(FLOOR, rel=0.01)


def test_smoothness_asks_for_flow_that_grows_evenly_but_not_across_an_edge() -> None:
    grey, step = torch.zeros((1, 3, 12, 16)), constant(0, 0)
    step[..., 8:] += 5
    edge = grey.clone()
    edge[..., 8:] = 1
    flat = smoothness_loss(constant(5, 5), grey, OWN).item()
    assert flat == pytest.approx(4 * FLOOR, rel=0.01)
    growing = constant(0, 0) + torch.arange(16.0)
    assert smoothness_loss(growing, grey, OWN).item() == pytest.approx(flat)
    assert smoothness_loss(step, edge, OWN).item() == pytest.approx(flat, rel=0.2)
    assert smoothness_loss(step, grey, OWN).item() > 20 * flat


def test_the_cycle_test_is_that_of_the_stored_flow() -> None:
    from tcrdata.evidence.flow_cycle import measure

    rng = np.random.default_rng(0)
    flows = rng.normal(0, 0.6, (2, 12, 16, 2)).astype(np.float32)
    wanted = measure(flows[0], flows[1]).paper
    there, back = torch.from_numpy(flows).permute(0, 3, 1, 2).unsqueeze(1)
    found = cycle_consistent(there, back, OWN)[0, 0].numpy() > 0
    assert 0.2 < wanted.mean() < 0.9
    np.testing.assert_array_equal(found, wanted)


def test_a_teacher_counts_where_it_is_trusted() -> None:
    trusted = EVERY.clone()
    trusted[..., :8] = 0
    taught = constant(1, 1)
    taught[..., :8] = 99
    assert imitation_loss(constant(1, 1), taught, trusted, OWN).item() == pytest.approx(2 * FLOOR)


def batch_of(images: tuple[torch.Tensor, torch.Tensor]) -> dict[str, torch.Tensor]:
    taught = torch.stack([constant(3, -2)[0], constant(-3, 2)[0]])[None]
    hidden = torch.zeros((1, 2, 1, 12, 16))
    hidden[..., :4] = 1
    return {
        "images": torch.stack([framed(image)[0] for image in images])[None],
        "taught": taught,
        "trusted": torch.ones((1, 2, 1, 12, 16)),
        "hidden": hidden,
    }


@pytest.mark.parametrize(
    ("alone", "terms"),
    [
        ("photometric", {"photometric", "smoothness"}),
        ("teacher", {"teacher"}),
        ("occlusion", {"occlusion"}),
    ],
)
def test_each_loss_can_be_run_alone(
    images: tuple[torch.Tensor, torch.Tensor], alone: str, terms: set[str]
) -> None:
    off = {name: 0.0 for name in ("photometric", "teacher", "occlusion") if name != alone}
    batch = batch_of(images)
    right = torch.stack([batch["taught"][0]] * 2, dim=1)
    wrong = right + 2
    wrong.requires_grad_(True)
    own = replace(OWN, unseen=0, **off)
    low = self_supervised_losses({"flow": right}, batch, own)
    high = self_supervised_losses({"flow": wrong}, batch, own)
    assert set(low) == set(high) == terms
    if alone != "photometric":
        assert sum(high.values()).item() > 10 * sum(low.values()).item()
    sum(high.values()).backward()
    reached = wrong.grad.abs().sum(dim=(0, 1, 2, 3)) > 0
    if alone == "teacher":
        assert not reached[:4].any()
        assert reached[4:].all()
    elif alone == "occlusion":
        assert reached[:4].all()
        assert not reached[4:].any()


def test_where_the_student_is_not_consistent_the_teacher_holds_it(
    images: tuple[torch.Tensor, torch.Tensor],
) -> None:
    batch = batch_of(images)
    own = replace(OWN, teacher=0, occlusion=0)
    right = torch.stack([batch["taught"][0]] * 2, dim=1)
    astray = right.clone()
    astray[..., 4:8, 6:10] += 3
    astray.requires_grad_(True)
    losses = self_supervised_losses({"flow": astray}, batch, own)
    assert set(losses) == {"photometric", "smoothness", "unseen"}
    losses["unseen"].backward()
    reached = astray.grad.abs().sum(dim=(0, 1, 2)) > 0
    assert reached[4:8, 6:10].all()
    # Its own place, and where the way back is looked up.
    assert reached.float().mean() < 0.6
    held = self_supervised_losses({"flow": right}, batch, own)["unseen"].item()
    assert losses["unseen"].item() > 3 * held


def test_no_loss_at_all_is_refused() -> None:
    with pytest.raises(SettingsError, match="no loss is left"):
        FlowLossSettings(photometric=0, teacher=0, occlusion=0)
    with pytest.raises(SettingsError, match=r"losses\.epsilon: above 0, and finite"):
        FlowLossSettings(epsilon=0)
    with pytest.raises(SettingsError, match=r"losses\.teacher: a weight of 0 or more"):
        FlowLossSettings(teacher=-1)


def test_known_flow_counts_later_iterations_more() -> None:
    flows = torch.stack([constant(2, 0), constant(1, 0)], dim=1)
    batch = {"flow": constant(0, 0).unsqueeze(1), "known": EVERY.unsqueeze(1)}
    loss = known_flow_losses({"flow": flows}, batch, KnownLossSettings(decay=0.5, matching=0))
    assert loss["known"].item() == pytest.approx(0.5 * 2 + 1)
    assert set(loss) == {"known"}


def moved_features(across: int) -> torch.Tensor:
    """(1, 2, 64, 8, 8): each cell its own kind, in the second image so many cells to the right."""
    first = torch.eye(64).view(1, 64, 8, 8)
    return torch.stack([first, first.roll(across, dims=3)], dim=1)


def test_features_match_where_flow_leads_and_nowhere_else() -> None:
    known = torch.ones(1, 1, 64, 64)
    flow = torch.zeros(1, 2, 64, 64)
    flow[:, 0] = 16.0
    right, wrong = (matching_loss(moved_features(n), flow, known, 100.0) for n in (2, 3))
    # A cell whose kind is found: log(1 + 63 exp(-s)), s the sharpness by sqrt(channels).
    assert right.item() == pytest.approx(np.log(1 + 63 * np.exp(-100 / 8)), rel=1e-3)
    assert wrong.item() == pytest.approx(100 / 8, rel=1e-3)


def test_between_cells_the_four_around_count_and_what_leaves_the_image_does_not() -> None:
    known = torch.ones(1, 1, 64, 64)
    flow = torch.zeros(1, 2, 64, 64)
    flow[:, 0] = 20.0
    half = matching_loss(moved_features(2), flow, known, 100.0)
    assert half.item() == pytest.approx(0.5 * 100 / 8, rel=1e-3)
    outside = matching_loss(moved_features(0), flow + 64, known, 100.0)
    unknown = matching_loss(moved_features(0), flow, 0 * known, 100.0)
    assert outside.item() == unknown.item() == 0


def test_an_image_that_is_padded_to_whole_cells_matches_where_no_padding_is() -> None:
    flow = torch.zeros(1, 2, 60, 62)
    known = torch.ones(1, 1, 60, 62)
    right, wrong = (matching_loss(moved_features(n), flow, known, 100.0) for n in (0, 1))
    assert right.item() < 0.01
    assert wrong.item() == pytest.approx(100 / 8, rel=1e-3)
