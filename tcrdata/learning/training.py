"""The training loop: one for detectors and segmenters, from the first sample to the last step."""

from __future__ import annotations

import copy
import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader

from tcrdata import registry
from tcrdata.errors import TrainingError
from tcrdata.learning.checkpoints import (
    AVERAGE,
    STATE,
    ModelIdentity,
    Progress,
    read_weights,
    save_checkpoint,
)
from tcrdata.learning.devices import Place
from tcrdata.learning.frames import Frames
from tcrdata.learning.stream import FrameStream, Transform
from tcrdata.networks.losses import OBJECTIVES
from tcrdata.networks.trained import load_state
from tcrdata.store import Store

Batch = dict[str, Any]


@dataclass(frozen=True)
class LoopSettings:
    """The loop's own settings.

    Attributes:
        steps: optimiser steps.
        batch: frames a step and process.
        learning_rate: largest of the cycle.
        weight_decay: of AdamW.
        warm_up: share of the steps in which the rate rises.
        clip: largest norm of the gradient.
        average: decay of the running average of the weights.
        mixed_precision: half precision where it helps: on a GPU.
        checkpoint_steps: steps between checkpoints.
        workers: processes that load frames beside the training; 0 loads inline.
        threads: torch's; more on few cores slow the loading down.
        seed: of weights, order and augmentation.
    """

    steps: int = 400
    batch: int = 4
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    warm_up: float = 0.1
    clip: float = 10.0
    average: float = 0.99
    mixed_precision: bool = True
    checkpoint_steps: int = 100
    workers: int = 1
    threads: int = 1
    seed: int = 0


@dataclass(frozen=True)
class Report:
    """What the loop says after a step: for a progress bar and logs, never for the store."""

    step: int
    steps: int
    loss: float
    terms: Mapping[str, float] = field(default_factory=dict)
    frames_per_s: float = 0.0


def one_cycle(share_done: float, warm_up: float) -> float:
    """Return the learning rate's factor: a cosine up from 0.04, then down to nearly nothing."""
    if share_done < warm_up:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * share_done / warm_up)) / 2
    left = (1 - share_done) / max(1 - warm_up, 1e-9)
    return 1e-4 + (1 - 1e-4) * (1 - math.cos(math.pi * left)) / 2


def train(
    store: Store,
    model: ModelIdentity,
    frames: Frames,
    transform: Transform,
    network_settings: Any,
    loop: LoopSettings,
    place: Place,
    *,
    resume: bool = False,
    report: Callable[[Report], None] = lambda _: None,
) -> Progress:
    """Train a network and commit its checkpoints; a resumed training gives the same losses.

    Args:
        store: gets the checkpoints.
        model: what the model follows from.
        frames: what it learns from.
        transform: makes a sample of a frame.
        network_settings: of the network.
        loop: the loop's own settings.
        place: device and process.
        resume: go on from the newest checkpoint.
        report: called after each step.

    Raises:
        TrainingError: the loss is not finite; names the frames of the batch.
        StoreError: the checkpoint is damaged or another architecture's.
    """
    torch.set_num_threads(loop.threads)
    torch.manual_seed(loop.seed)
    network = registry.find("networks", model.network).make_network(network_settings)
    network.to(place.device, memory_format=torch.channels_last).train()
    averaged = copy.deepcopy(network)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=loop.weight_decay)
    losses, terms = _restored(store, model, network, averaged, optimizer) if resume else ([], [])
    spread = nn.parallel.DistributedDataParallel(network) if place.world_size > 1 else network
    scaler = torch.amp.GradScaler(enabled=_half(loop, place))
    counts = _counts(frames, network, loop)

    for step, batch in enumerate(
        _batches(frames, transform, loop, place, len(losses)), len(losses)
    ):
        if step >= loop.steps:
            break
        started = time.perf_counter()
        for group in optimizer.param_groups:
            group["lr"] = loop.learning_rate * one_cycle(step / loop.steps, loop.warm_up)
        with torch.autocast(torch.device(place.device).type, enabled=_half(loop, place)):
            outputs = spread(batch["input"])
        outputs = {name: output.float() for name, output in outputs.items()}
        parts = OBJECTIVES[model.kind](outputs, batch)
        loss = torch.stack(list(parts.values())).sum()
        _check_finite(loss, parts, batch, step)
        optimizer.zero_grad()
        scaler.scale(loss).backward()
        scaler.unscale_(optimizer)
        nn.utils.clip_grad_norm_(network.parameters(), loop.clip)
        scaler.step(optimizer)
        scaler.update()
        _average(averaged, network, min(loop.average, (step + 1) / (step + 10)))
        losses.append(float(loss.detach()))
        terms.append({name: float(part.detach()) for name, part in parts.items()})
        rate = loop.batch * place.world_size / (time.perf_counter() - started)
        report(Report(step + 1, loop.steps, losses[-1], terms[-1], rate))
        if place.rank == 0 and ((step + 1) % loop.checkpoint_steps == 0 or step + 1 == loop.steps):
            _save(store, model, network, averaged, optimizer, losses, terms, counts)
    return _progress(losses, terms, counts)


def _half(loop: LoopSettings, place: Place) -> bool:
    """Half precision slows CPUs down and helps GPUs."""
    return loop.mixed_precision and place.device.startswith("cuda")


def _batches(
    frames: Frames, transform: Transform, loop: LoopSettings, place: Place, step: int
) -> Iterator[Batch]:
    """Yield batches from a step on, on the device; the same whatever the number of workers."""
    stream = FrameStream(
        frames,
        seed=loop.seed,
        start=step * loop.batch * place.world_size,
        epochs=None,
        rank=place.rank,
        world_size=place.world_size,
        transform=transform,
    )
    # Forked processes could inherit locks of this one's threads.
    context = "forkserver" if loop.workers else None
    loader = DataLoader(
        stream, batch_size=None, num_workers=loop.workers, multiprocessing_context=context,
        prefetch_factor=2 * loop.batch if loop.workers else None,
    )  # fmt: skip
    samples = iter(loader)
    while True:
        yield collated(list(itertools.islice(samples, loop.batch)), place.device)


def collated(samples: list[dict[str, Any]], device: str) -> Batch:
    """Stack the arrays of samples to tensors (B, ...) on a device; other values become lists."""
    batch: Batch = {}
    for name in samples[0]:
        values = [sample[name] for sample in samples]
        if isinstance(values[0], np.ndarray | torch.Tensor):
            tensors = [torch.as_tensor(value) for value in values]
            stacked = torch.stack(tensors).to(device, non_blocking=True)
            # Convolutions of images are a third faster so, on CPUs too.
            batch[name] = (
                stacked.contiguous(memory_format=torch.channels_last)
                if name == "input" and stacked.ndim == 4
                else stacked
            )
        else:
            batch[name] = values
    return batch


def _check_finite(
    loss: torch.Tensor, parts: Mapping[str, torch.Tensor], batch: Batch, step: int
) -> None:
    if not bool(torch.isfinite(loss)):
        wrong = [name for name, part in parts.items() if not bool(torch.isfinite(part))]
        raise TrainingError(
            f"step {step + 1}: the loss is {float(loss.detach())} ({', '.join(wrong)}) on the "
            f"frames {', '.join(batch['key'])}: look at their labels, or lower learning_rate; "
            "--resume goes on from the last checkpoint"
        )


@torch.no_grad()
def _average(averaged: nn.Module, network: nn.Module, decay: float) -> None:
    """Move the averaged weights a step towards the network's."""
    pairs = zip(averaged.state_dict().values(), network.state_dict().values(), strict=True)
    for mean, value in pairs:
        if mean.is_floating_point():
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def _counts(frames: Frames, network: nn.Module, loop: LoopSettings) -> dict[str, int]:
    return {
        "steps": loop.steps,
        "samples": len(frames),
        "positives": int(sum(frames.column("positives"))),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
    }


def _progress(
    losses: list[float], terms: list[dict[str, float]], counts: Mapping[str, int]
) -> Progress:
    last = terms[-max(counts["steps"] // 10, 1) :]
    means = {name: float(np.mean([term[name] for term in last])) for name in (last or [{}])[0]}
    return Progress(step=len(losses), losses=tuple(losses), terms=means, **counts)


def _save(
    store: Store,
    model: ModelIdentity,
    network: nn.Module,
    averaged: nn.Module,
    optimizer: torch.optim.Optimizer,
    losses: list[float],
    terms: list[dict[str, float]],
    counts: Mapping[str, int],
) -> None:
    state = {
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
        "losses": losses,
        "terms": terms,
    }
    parts = {AVERAGE: averaged.state_dict(), STATE: state}
    save_checkpoint(store, model, _progress(losses, terms, counts), parts)


def _restored(
    store: Store,
    model: ModelIdentity,
    network: nn.Module,
    averaged: nn.Module,
    optimizer: torch.optim.Optimizer,
) -> tuple[list[float], list[dict[str, float]]]:
    """Load the newest checkpoint; return what was lost so far, step by step."""
    what = f"{store.url}: model {model.model_id}"
    state = read_weights(store, model.model_id, STATE)
    load_state(network, state["network"], what)
    load_state(averaged, read_weights(store, model.model_id, AVERAGE), what)
    optimizer.load_state_dict(state["optimizer"])
    return list(state["losses"]), list(state["terms"])
