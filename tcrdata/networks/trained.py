"""A network as a store holds it: its name, its settings as JSON, and bytes of `torch.save`."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pickle import UnpicklingError
from types import ModuleType
from typing import Any

import torch
from torch import nn

from tcrdata import registry
from tcrdata.errors import StoreError
from tcrdata.settings import overridden

UNREADABLE = (
    OSError, RuntimeError, EOFError, ValueError, LookupError, TypeError, AttributeError,
    UnpicklingError,
)  # fmt: skip
"""What `torch.load` raises at bytes that it did not write."""


@dataclass(frozen=True)
class Trained:
    """A network ready to measure with.

    Attributes:
        module: its module of `tcrdata.networks`.
        settings: of the network.
        network: in evaluation mode, on the CPU.
    """

    module: ModuleType
    settings: Any
    network: nn.Module


def to_bytes(value: Any) -> bytes:
    """Return tensors, numbers and dicts of them as bytes."""
    buffer = io.BytesIO()
    torch.save(value, buffer)
    return buffer.getvalue()


def from_bytes(data: bytes, what: str) -> Any:
    """Read `to_bytes` back, on the CPU.

    Raises:
        StoreError: the bytes are something else; `what` says whose they are.
    """
    try:
        return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except UNREADABLE as error:
        raise StoreError(
            f"{what}: {len(data)} bytes that are no weights ({type(error).__name__}): "
            "the store is damaged; train again"
        ) from error


def settings_of(module: ModuleType, plain: Mapping[str, Any]) -> Any:
    """Return a network's settings from plain values, as a row of `models` has them."""
    texts = {name: v if isinstance(v, str) else json.dumps(v) for name, v in plain.items()}
    # A trained network has its weights: the file it once began with may be gone.
    texts.pop("backbone_weights", None)
    return overridden(module.Settings(), texts, "network")


def load_state(network: nn.Module, state: Mapping[str, torch.Tensor], what: str) -> None:
    """Load weights into a network.

    Raises:
        StoreError: they are another architecture's; names what differs first.
    """
    wanted = network.state_dict()
    wrong = sorted(
        name
        for name in wanted.keys() | state.keys()
        if getattr(wanted.get(name), "shape", None) != getattr(state.get(name), "shape", None)
    )
    if wrong:
        raise StoreError(
            f"{what}: the checkpoint is of another architecture: {len(wrong)} entries differ, "
            f"first {wrong[0]}; train a new model, or use the settings it was trained with"
        )
    network.load_state_dict(dict(state))


def trained_network(name: str, plain: Mapping[str, Any], data: bytes, what: str) -> Trained:
    """Return a network with the weights of a checkpoint.

    Args:
        name: module of `tcrdata.networks`, or a dotted path.
        plain: the network's settings as plain values.
        data: the checkpoint's part `average`.
        what: whose they are, for messages.

    Raises:
        StoreError: the bytes are no weights, or another architecture's.
    """
    module = registry.find("networks", name)
    settings = settings_of(module, plain)
    network = module.make_network(settings)
    load_state(network, from_bytes(data, what), what)
    return Trained(module, settings, network.eval())
