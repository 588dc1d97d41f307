"""RAFT: names and shapes of the published weights, any size of image, flow both ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from tcrdata.errors import SettingsError
from tcrdata.evidence.flow_estimators import Raft as Estimator
from tcrdata.networks import correlation, raft
from tcrdata.networks.correlation import LEVELS, CorrelationPyramid
from tcrdata.networks.raft import Raft, Settings
from tcrdata.networks.raft_weights import raft_shapes, read_raft_weights, weights_digest
from tcrdata.networks.trained import to_bytes

SIZES = ("small", "full")


def published_shapes(size: str) -> dict[str, tuple[int, ...]]:
    """Name and shape of every weight of the published networks, as their files have them."""
    text = Path(__file__).with_name(f"raft_{size}.txt").read_text(encoding="utf-8")
    rows = [line.split() for line in text.splitlines()]
    return {
        name: () if shape == "scalar" else tuple(map(int, shape.split("x"))) for name, shape in rows
    }


def published_state(size: str) -> dict[str, torch.Tensor]:
    """Weights of exactly those names and shapes."""
    drawn = torch.Generator().manual_seed(0)
    state = {}
    for name, shape in published_shapes(size).items():
        if not shape:
            state[name] = torch.tensor(7)
        else:
            state[name] = 0.05 * torch.randn(shape, generator=drawn).abs()
    for name in state:
        # Both names are of one norm.
        if ".downsample.1." in name:
            state[name] = state[name.replace("downsample.1", "norm3")]
    return state


@pytest.fixture(scope="module")
def networks() -> dict[str, Raft]:
    """Of random weights, the last ones too, which begin as zeros."""
    torch.manual_seed(0)
    made = {size: Raft(Settings(size=size, iterations=2)).eval() for size in SIZES}
    for network in made.values():
        torch.nn.init.normal_(network.update_block.flow_head.conv2.weight, std=0.02)
    return made


def test_what_has_learnt_nothing_says_that_nothing_moves() -> None:
    with torch.inference_mode():
        flow = Raft(Settings(iterations=2)).eval()(pair_of(64, 64))["flow"]
    assert not flow.any()


def pair_of(height: int, width: int, batch: int = 1) -> torch.Tensor:
    return torch.rand((batch, 6, height, width), generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("size", SIZES)
def test_weights_have_the_published_names_and_shapes(size: str) -> None:
    assert raft_shapes(size) == published_shapes(size)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("before", ["", "module."])
def test_a_file_of_the_published_shapes_loads(
    tmp_path: Path, networks: dict[str, Raft], size: str, before: str
) -> None:
    state = published_state(size)
    path = str(tmp_path / "raft.pth")
    torch.save({before + name: value for name, value in state.items()}, path)
    found, read = read_raft_weights(path)
    assert found == size
    assert weights_digest(read) == weights_digest(state)
    network = Raft(Settings(size=size, iterations=1)).eval()
    network.load_state_dict(read)
    assert torch.equal(network.state_dict()["cnet.conv1.weight"], state["cnet.conv1.weight"])
    with torch.inference_mode():
        assert torch.isfinite(network(pair_of(64, 64))["flow"]).all()


def saved(tmp_path: Path, value: object) -> str:
    path = tmp_path / "raft.pth"
    torch.save(value, path)
    return str(path)


def test_a_file_that_does_not_fit_is_refused_by_name(tmp_path: Path) -> None:
    state = published_state("small")
    lacking = {name: v for name, v in state.items() if name != "fnet.layer2.0.conv1.bias"}
    with pytest.raises(SettingsError, match=r"lacks RAFT small: fnet\.layer2\.0\.conv1\.bias"):
        read_raft_weights(saved(tmp_path, lacking))
    foreign = {**state, "head.weight": torch.zeros(1)}
    with pytest.raises(SettingsError, match=r"not in RAFT small: head\.weight"):
        read_raft_weights(saved(tmp_path, foreign))
    other = {**state, "fnet.conv2.bias": torch.zeros(7)}
    with pytest.raises(SettingsError, match=r"other shapes than RAFT small: fnet\.conv2\.bias"):
        read_raft_weights(saved(tmp_path, other))
    odd = {**state, "fnet.conv2.bias": state["fnet.conv2.bias"] * torch.nan}
    with pytest.raises(SettingsError, match=r"not finite for RAFT small: fnet\.conv2\.bias"):
        read_raft_weights(saved(tmp_path, odd))
    with pytest.raises(SettingsError, match="weights of RAFT small, not full: give --size small"):
        read_raft_weights(saved(tmp_path, state), "full")


def test_what_is_no_file_of_weights_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot be read: No such file"):
        read_raft_weights(str(tmp_path / "none.pth"))
    (tmp_path / "text.pth").write_text("weights")
    with pytest.raises(SettingsError, match="no file of weights"):
        read_raft_weights(str(tmp_path / "text.pth"))
    with pytest.raises(SettingsError, match="holds a list, not a state dict"):
        read_raft_weights(saved(tmp_path, [1, 2]))
    with pytest.raises(SettingsError, match="holds a dict, not a state dict"):
        read_raft_weights(saved(tmp_path, {0: torch.zeros(1)}))
    with pytest.raises(SettingsError, match=r"save the network's state_dict\(\) alone"):
        read_raft_weights(saved(tmp_path, {"state_dict": published_state("small"), "epoch": 3}))
    with pytest.raises(SettingsError, match=r"network\.size: 'medium' is none of small, full"):
        Settings(size="medium")


def test_weights_of_half_precision_or_with_gradients_are_read_as_plain_ones(
    tmp_path: Path,
) -> None:
    state = published_state("small")
    half = {name: value.bfloat16() for name, value in state.items()}
    _, read = read_raft_weights(saved(tmp_path, half))
    torch.testing.assert_close(read, {name: value.float() for name, value in half.items()})
    traced = {name: torch.nn.Parameter(value) for name, value in state.items()}
    _, read = read_raft_weights(saved(tmp_path, traced))
    assert not any(value.requires_grad for value in read.values())
    assert weights_digest(read) == weights_digest(state)


@pytest.mark.parametrize("size", SIZES)
def test_an_odd_size_is_padded_with_its_edges(networks: dict[str, Raft], size: str) -> None:
    pair = pair_of(67, 101)
    padded = functional.pad(pair, (1, 2, 2, 3), mode="replicate")
    assert padded.shape[-2:] == (72, 104)
    with torch.inference_mode():
        own, whole = networks[size](pair)["flow"], networks[size](padded)["flow"]
    assert own.shape == (1, 1, 2, 67, 101)
    assert own.abs().mean() > 0.1
    torch.testing.assert_close(own, whole[..., 2:-3, 1:-2])


def test_a_tiny_image_has_flow(networks: dict[str, Raft]) -> None:
    with torch.inference_mode():
        flow = networks["small"](pair_of(3, 5))["flow"]
    assert flow.shape == (1, 1, 2, 3, 5)
    assert torch.isfinite(flow).all()


@pytest.mark.parametrize("size", SIZES)
def test_both_ways_is_each_way(networks: dict[str, Raft], size: str) -> None:
    both = Raft(Settings(size=size, iterations=2, both_ways=True)).eval()
    both.load_state_dict(networks[size].state_dict())
    pairs = pair_of(64, 72, batch=2)
    with torch.inference_mode():
        flows = both(pairs)["flow"]
        forward = networks[size](pairs)["flow"]
        backward = networks[size](torch.cat([pairs[:, 3:], pairs[:, :3]], dim=1))["flow"]
    torch.testing.assert_close(flows[0::2], forward, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(flows[1::2], backward, atol=1e-4, rtol=1e-4)


def test_training_gives_every_iteration_and_frozen_norms_stay() -> None:
    network = Raft(Settings(size="full", iterations=3, frozen_norms=True)).train()
    before = network.state_dict()["cnet.norm1.running_mean"].clone()
    assert network(pair_of(64, 64))["flow"].shape[1] == 3
    assert torch.equal(network.state_dict()["cnet.norm1.running_mean"], before)
    free = Raft(Settings(size="full", iterations=1)).train()
    free(pair_of(64, 64))
    assert free.state_dict()["cnet.norm1.running_mean"].abs().sum() > 0


@pytest.mark.parametrize("largest_bytes", [2**30, 0])
def test_looks_are_bilinear_samples_of_the_averaged_correlations(largest_bytes: int) -> None:
    drawn = torch.Generator().manual_seed(3)
    first, second = (torch.randn((1, 5, 9, 10), generator=drawn) for _ in range(2))
    ends = torch.rand((1, 2, 9, 10), generator=drawn) * 14 - 3
    found = CorrelationPyramid(first, second, 1, largest_bytes).look(ends)
    assert found.shape == (1, LEVELS * 9, 9, 10)
    volume = torch.einsum("bchw,bcij->bhwij", first, second).reshape(90, 1, 9, 10) / 5**0.5
    for level in range(LEVELS):
        if level:
            volume = functional.avg_pool2d(volume, 2)
        height, width = volume.shape[-2:]
        center = ends[0].permute(1, 2, 0).reshape(90, 1, 2) / 2**level
        steps = torch.tensor([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
        places = (2 * (center + steps) + 1) / torch.tensor([width, height]) - 1
        wanted = functional.grid_sample(volume, places[:, None], align_corners=False)
        got = found[0, 9 * level : 9 * level + 9].permute(1, 2, 0).reshape(90, 9)
        torch.testing.assert_close(got, wanted[:, 0, 0], atol=1e-5, rtol=1e-4)


def test_large_images_have_the_same_flow_though_no_correlation_is_kept(
    networks: dict[str, Raft], monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = pair_of(64, 88, batch=2)
    with torch.inference_mode():
        kept = networks["small"](pair)["flow"]
        made: list[int] = []

        def small_pyramid(first: torch.Tensor, *others: object) -> CorrelationPyramid:
            made.append(len(first))
            return CorrelationPyramid(first, *others, largest_bytes=0)  # type: ignore[misc, arg-type]

        monkeypatch.setattr(raft, "CorrelationPyramid", small_pyramid)
        monkeypatch.setattr(correlation, "CHUNK_BYTES", 2**18)
        found = networks["small"](pair)["flow"]
    assert made == [2]
    torch.testing.assert_close(found, kept, atol=1e-4, rtol=1e-4)


@pytest.fixture(scope="module")
def estimator(networks: dict[str, Raft]) -> Estimator:
    weights = to_bytes(networks["small"].state_dict())
    return Estimator("random", '{"size": "small"}', weights, iterations=2)


def test_grey_images_are_images_of_equal_colours(estimator: Estimator) -> None:
    first, second = np.random.default_rng(0).integers(0, 256, (2, 65, 71), dtype=np.uint8)
    grey = estimator.both_ways(first, second)
    colours = estimator.both_ways(*(np.dstack([i] * 3) for i in (first, second)))
    for one, other in zip(grey, colours, strict=True):
        assert one.shape == (65, 71, 2)
        np.testing.assert_array_equal(one, other)


def test_a_black_frame_gives_finite_flow(estimator: Estimator) -> None:
    black = np.zeros((64, 80, 3), np.uint8)
    seen = np.random.default_rng(0).integers(0, 256, black.shape, dtype=np.uint8)
    for pair in ((black, black), (black, seen), (seen, black)):
        for flow in estimator.both_ways(*pair):
            assert np.isfinite(flow).all()
