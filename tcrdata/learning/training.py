"""The training loop: one for every kind of network, from the first sample to the last step."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset

from tcrdata.errors import SettingsError, TcrdataError, TrainingError
from tcrdata.executors import end_with_parent
from tcrdata.learning.checkpoints import ModelIdentity, Progress, save_checkpoint
from tcrdata.learning.devices import Place
from tcrdata.learning.learner import Batch, Learner, LearnerSettings, Objective
from tcrdata.learning.stream import CountedSamples, FrameStream, Transform
from tcrdata.store import Store

_LEAST = {
    "steps": 1, "batch": 1, "checkpoint_steps": 1, "threads": 1, "workers": 0, "learning_rate": 0,
    "weight_decay": 0, "clip": 0,
}  # fmt: skip


@dataclass(frozen=True)
class LoopSettings(LearnerSettings):
    """The loop's own settings, beside those of the learner.

    Attributes:
        steps: optimiser steps.
        batch: frames a step and process.
        warm_up: share of the steps in which the learning rate rises.
        checkpoint_steps: steps between checkpoints.
        workers: processes that load frames beside the training; 0 loads inline.
        threads: torch's; more on few cores slow the loading down.
    """

    steps: int = 800
    batch: int = 4
    warm_up: float = 0.1
    checkpoint_steps: int = 100
    workers: int = 1
    threads: int = 1

    def __post_init__(self) -> None:
        """Refuse what no step can be made with.

        Raises:
            SettingsError: no step, batch, checkpoint or thread, or a number that is none.
        """
        for name, least in _LEAST.items():
            if not least <= getattr(self, name) < math.inf:
                raise SettingsError(f"train.{name}: at least {least}, and finite")
        for name in ("warm_up", "average"):
            if not 0 <= getattr(self, name) <= 1:
                raise SettingsError(f"train.{name}: a share from 0 to 1")


@dataclass(frozen=True)
class Report:
    """What the loop says after a step: for a progress bar and logs, never for the store."""

    step: int
    steps: int
    loss: float
    terms: Mapping[str, float] = field(default_factory=dict)
    frames_per_s: float = 0.0
    learning_rate: float = 0.0


def train(
    store: Store,
    model: ModelIdentity,
    frames: CountedSamples,
    transform: Transform,
    network_settings: Any,
    loop: LoopSettings,
    place: Place,
    *,
    resume: bool = False,
    report: Callable[[Report], None] = lambda _: None,
    objective: Objective | None = None,
    start: Mapping[str, torch.Tensor] | None = None,
    start_counts: bool = False,
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
        report: called after each step, of several processes by the first alone.
        objective: what is learnt; None for the objective of the model's kind.
        start: weights to begin with; None for random ones.
        start_counts: the running average is of these, too: it stays near them.

    Raises:
        TrainingError: the loss is not finite; names the frames of the batch.
        StoreError: the checkpoint is damaged or another architecture's.
        ConflictError: another training has finished the model meanwhile.
    """
    torch.set_num_threads(loop.threads)
    learner = Learner(
        model.kind, model.network, network_settings, loop, place,
        objective=objective, start=start, start_counts=start_counts,
    )  # fmt: skip
    if resume:
        learner.restore(store, model)
    first, started = len(learner.terms), time.perf_counter()
    batches = _batches(frames, transform, loop, place, first)
    for step, batch in zip(range(first, loop.steps), batches, strict=False):
        factor = one_cycle(step / loop.steps, loop.warm_up)
        terms = learner.step(batch, factor)
        loss = sum(terms.values())
        if not math.isfinite(loss):
            raise _not_finite(step, terms, batch)
        done, seconds = step + 1, time.perf_counter() - started
        rate = (done - first) * loop.batch * place.world_size / seconds
        if place.rank > 0:
            continue
        report(Report(done, loop.steps, loss, terms, rate, factor * loop.learning_rate))
        if done % loop.checkpoint_steps == 0 or done == loop.steps:
            save_checkpoint(store, model, _progress(learner, frames, loop), learner.parts())
    return _progress(learner, frames, loop)


def one_cycle(share_done: float, warm_up: float) -> float:
    """Return the learning rate's factor: a cosine up from 0.04, then down to nearly nothing."""
    if share_done < warm_up:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * share_done / warm_up)) / 2
    left = (1 - share_done) / max(1 - warm_up, 1e-9)
    return 1e-4 + (1 - 1e-4) * (1 - math.cos(math.pi * left)) / 2


def _batches(
    frames: CountedSamples, transform: Transform, loop: LoopSettings, place: Place, step: int
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
    loader = DataLoader(
        _ErrorsAsValues(stream),
        batch_size=None,
        num_workers=loop.workers,
        # Forked processes could inherit locks of this one's threads.
        multiprocessing_context="forkserver" if loop.workers else None,
        worker_init_fn=end_with_parent,
        prefetch_factor=2 * loop.batch if loop.workers else None,
    )
    samples = map(_unless_error, loader)
    while True:
        yield collated(list(itertools.islice(samples, loop.batch)), place.device)


class _ErrorsAsValues(IterableDataset[dict[str, Any] | TcrdataError]):
    """A stream that ends with the error that it meets, as a value.

    What a loader's process raises comes with that process's traceback in its message.
    """

    def __init__(self, stream: FrameStream) -> None:
        super().__init__()
        self._stream = stream

    def __iter__(self) -> Iterator[dict[str, Any] | TcrdataError]:
        try:
            yield from self._stream
        except TcrdataError as error:
            yield error


def _unless_error(sample: dict[str, Any] | TcrdataError) -> dict[str, Any]:
    if isinstance(sample, TcrdataError):
        raise sample
    return sample


def collated(samples: list[dict[str, Any]], device: str) -> Batch:
    """Stack the arrays of samples to tensors (B, ...) on a device; other values become lists.

    Raises:
        SettingsError: arrays of one name differ in size.
    """
    batch: Batch = {}
    for name in samples[0]:
        values = [sample[name] for sample in samples]
        if not isinstance(values[0], np.ndarray | torch.Tensor):
            batch[name] = values
            continue
        if len({tuple(value.shape) for value in values}) > 1:
            sizes = " and ".join(sorted({str(tuple(value.shape)) for value in values}))
            raise SettingsError(
                f"samples of a step differ in size ({name}: {sizes}): give batch=1, or smaller "
                "pieces"
            )
        stacked = torch.stack([torch.as_tensor(value) for value in values])
        stacked = stacked.to(device, non_blocking=True)
        if name == "input" and stacked.ndim == 4:
            # Convolutions of images are a third faster so, on CPUs too.
            stacked = stacked.contiguous(memory_format=torch.channels_last)
        batch[name] = stacked
    return batch


def _not_finite(step: int, terms: Mapping[str, float], batch: Batch) -> TrainingError:
    wrong = ", ".join(f"{name} {value}" for name, value in terms.items() if not np.isfinite(value))
    return TrainingError(
        f"step {step + 1}: the loss is not finite ({wrong}) on the frames "
        f"{', '.join(batch['key'])}: look at their labels, or lower learning_rate; "
        "--resume goes on from the last checkpoint"
    )


def _progress(learner: Learner, frames: CountedSamples, loop: LoopSettings) -> Progress:
    last = learner.terms[-max(loop.steps // 10, 1) :]
    means = {name: float(np.mean([terms[name] for terms in last])) for name in (last or [{}])[0]}
    return Progress(
        step=len(learner.terms),
        steps=loop.steps,
        losses=tuple(sum(terms.values()) for terms in learner.terms),
        terms=means,
        samples=len(frames),
        positives=int(sum(frames.column("positives"))),
        parameters=sum(parameter.numel() for parameter in learner.network.parameters()),
    )
