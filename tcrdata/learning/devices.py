"""Where a network runs, and with how many other processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch

from tcrdata.errors import SettingsError


@dataclass(frozen=True)
class Place:
    """One process of a training.

    Attributes:
        device: what torch calls it.
        rank: number of this process.
        world_size: number of processes; `torchrun` starts several.
    """

    device: str
    rank: int = 0
    world_size: int = 1


def device_named(name: str) -> str:
    """Return torch's name of a device; `auto` is the GPU where there is one.

    Raises:
        SettingsError: torch knows no such device, or this machine has none.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        kind = torch.device(name).type
    except RuntimeError as error:
        raise SettingsError(f"--device {name} is no device: give auto, cpu or cuda") from error
    if kind == "cuda" and not torch.cuda.is_available():
        raise SettingsError(
            f"--device {name}: this machine has no GPU that torch {torch.__version__} can use; "
            "leave --device out, or give cpu"
        )
    return name


@contextmanager
def training_place(device: str) -> Iterator[Place]:
    """Yield this process's place; under `torchrun` join the others first, and leave them after.

    Raises:
        SettingsError: no such device.
    """
    named = device_named(device)
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield Place(named)
        return
    gpu = named.startswith("cuda")
    torch.distributed.init_process_group("nccl" if gpu else "gloo")
    try:
        own = f"cuda:{os.environ['LOCAL_RANK']}" if gpu else named
        yield Place(own, torch.distributed.get_rank(), torch.distributed.get_world_size())
    finally:
        torch.distributed.destroy_process_group()
