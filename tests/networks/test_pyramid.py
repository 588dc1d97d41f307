"""The 2D segmenter and the files of weights that it takes."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from tcrdata.errors import SettingsError
from tcrdata.networks.pyramid import Settings, make_network
from tcrdata.networks.resnet import ResNet


def test_one_logit_every_four_pixels() -> None:
    network = make_network(Settings(width=16)).eval()
    with torch.inference_mode():
        logits = network(torch.rand(1, 3, 64, 96))["objectness"]
    assert logits.shape == (1, 1, 16, 24)


def test_odd_sizes_pass() -> None:
    network = make_network(Settings(width=8)).eval()
    with torch.inference_mode():
        assert network(torch.rand(1, 3, 75, 131))["objectness"].shape == (1, 1, 19, 33)


@pytest.mark.parametrize(
    ("depth", "entries", "names"),
    [
        (18, 120, {"layer2.0.downsample.0.weight": (128, 64, 1, 1), "bn1.running_mean": (64,)}),
        (
            50,
            318,
            {
                "conv1.weight": (64, 3, 7, 7),
                "layer1.0.conv3.weight": (256, 64, 1, 1),
                "layer1.0.downsample.1.num_batches_tracked": (),
                "layer3.5.bn3.running_var": (1024,),
                "layer4.2.conv2.weight": (512, 512, 3, 3),
            },
        ),
    ],
)
def test_parameters_have_torchvisions_names(
    depth: int, entries: int, names: dict[str, tuple[int, ...]]
) -> None:
    state = ResNet(depth).state_dict()
    assert len(state) == entries
    assert {name: tuple(state[name].shape) for name in names} == names


def test_imagenet_weights_load_from_a_file_without_the_classifier(tmp_path: Path) -> None:
    state = ResNet(18).state_dict()
    state["fc.weight"], state["fc.bias"] = torch.zeros(1000, 512), torch.zeros(1000)
    torch.save(state, tmp_path / "resnet18.pth")
    network = make_network(Settings(backbone_weights=str(tmp_path / "resnet18.pth")))
    assert torch.equal(network.backbone.conv1.weight, state["conv1.weight"])


def test_a_file_of_another_network_is_refused(tmp_path: Path) -> None:
    torch.save(ResNet(18).state_dict(), tmp_path / "small.pth")
    with pytest.raises(SettingsError, match=r"does not fit this ResNet.*network\.depth"):
        make_network(Settings(depth=50, backbone_weights=str(tmp_path / "small.pth")))


@pytest.mark.parametrize("content", [b"", b"not weights at all", b"\x80\x02]q\x00."])
def test_a_file_that_holds_no_weights_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "weights.pth"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=r"not a file of weights|not a state dict"):
        make_network(Settings(backbone_weights=str(path)))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(SettingsError, match=r"nowhere\.pth: there is no such file"):
        make_network(Settings(backbone_weights="nowhere.pth"))


def test_another_depth_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"network\.depth: 34"):
        Settings(depth=34)
