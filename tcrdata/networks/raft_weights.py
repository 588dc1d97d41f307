"""RAFT's weights from a file, under the names and shapes of the published networks."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache

import torch

from tcrdata.errors import SettingsError
from tcrdata.networks.raft import SIZES, Settings, make_network
from tcrdata.networks.trained import UNREADABLE

_PARALLEL = "module."
"""Before every name in a file that was saved from several GPUs, as the published ones were."""


@cache
def raft_shapes(size: str) -> dict[str, tuple[int, ...]]:
    """Return name and shape of each weight of a size, small or full."""
    with torch.device("meta"):
        network = make_network(Settings(size=size))
    return {name: tuple(value.shape) for name, value in network.state_dict().items()}


def read_raft_weights(path: str, size: str | None = None) -> tuple[str, dict[str, torch.Tensor]]:
    """Return the size and the state dict of a file.

    Args:
        path: of a file that `torch.save` wrote.
        size: what is wanted, small or full; None for whichever the file holds.

    Raises:
        SettingsError: no such file, no state dict, a weight that is missing, foreign, of another
            shape or not finite (named), or weights of the other size.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise SettingsError(f"--weights {path}: cannot be read: {error.strerror}") from error
    except UNREADABLE as error:
        raise SettingsError(
            f"--weights {path}: no file of weights ({type(error).__name__}): give a state dict "
            "saved with torch.save"
        ) from error
    if not _is_state_dict(state):
        raise SettingsError(
            f"--weights {path}: holds a {type(state).__name__}, not a state dict: save the "
            "network's state_dict() alone"
        )
    if state and all(name.startswith(_PARALLEL) for name in state):
        state = {name.removeprefix(_PARALLEL): value for name, value in state.items()}
    found = _nearest_size(state)
    if size is not None and size != found:
        raise SettingsError(
            f"--weights {path}: weights of RAFT {found}, not {size}: give --size {found}"
        )
    _check(path, found, state)
    return found, {name: _plain(state[name]) for name in raft_shapes(found)}


def weights_digest(state: Mapping[str, torch.Tensor]) -> str:
    """Return the sha256 of weights, the same however they were saved."""
    digest = hashlib.sha256()
    for name in sorted(state):
        digest.update(f"{name} {tuple(state[name].shape)} {state[name].dtype}\n".encode())
        digest.update(state[name].contiguous().numpy().tobytes())
    return digest.hexdigest()


def _is_state_dict(value: object) -> bool:
    return isinstance(value, dict) and all(
        isinstance(name, str) and torch.is_tensor(weight) for name, weight in value.items()
    )


def _plain(weight: torch.Tensor) -> torch.Tensor:
    """A weight in single precision that nothing is traced through, however it was saved."""
    return weight.detach().float() if weight.is_floating_point() else weight


def _nearest_size(state: Mapping[str, torch.Tensor]) -> str:
    """The size that has most of the weights."""
    own = {(name, tuple(value.shape)) for name, value in state.items()}
    return max(SIZES, key=lambda size: len(own & set(raft_shapes(size).items())))


def _check(path: str, size: str, state: Mapping[str, torch.Tensor]) -> None:
    wanted = raft_shapes(size)
    problems = {
        "lacks": sorted(wanted.keys() - state.keys()),
        "has what is not in": sorted(state.keys() - wanted.keys()),
        "has other shapes than": sorted(
            name for name in wanted.keys() & state.keys() if wanted[name] != state[name].shape
        ),
        "has numbers that are not finite for": sorted(
            name for name, value in state.items() if not torch.isfinite(value).all()
        ),
    }
    for what, names in problems.items():
        if names:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            raise SettingsError(
                f"--weights {path}: {what} RAFT {size}: {', '.join(names[:3])}{more}; give a whole "
                "state dict of RAFT small or full"
            )
