"""Samples in a shuffled order that is the same however many processes load them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from torch.utils.data import IterableDataset, get_worker_info

from tcrdata.errors import SettingsError
from tcrdata.learning.frames import open_frames
from tcrdata.store import open_store
from tcrdata.types import IntArray

Transform = Callable[[dict[str, Any], np.random.Generator], dict[str, Any]]


class Samples(Protocol):
    """What can be streamed: frames of a query, pairs of them, or what is generated. Picklable."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return one sample by its number."""
        ...

    def drives(self) -> IntArray:
        """Return (N,) which drive each sample is of, numbered from 0."""
        ...


class CountedSamples(Samples, Protocol):
    """Samples that a training can count the labels of."""

    def column(self, name: str) -> list[Any]:
        """Return one value a sample; a training asks for `positives`."""
        ...


class FrameStream(IterableDataset[dict[str, Any]]):
    """Frames in an order shuffled anew each epoch, endless unless `epochs` bounds it.

    Every sample holds its `position`; a stream with `start=position + 1` goes on right behind it.
    With `DataLoader(stream, batch_size=None)` samples come in the same order whatever the number
    of workers; ranks take every `world_size`-th position.
    """

    def __init__(
        self,
        frames: Samples,
        *,
        seed: int = 0,
        start: int = 0,
        epochs: int | None = 1,
        shuffle: bool = True,
        drives_together: int = 8,
        rank: int = 0,
        world_size: int = 1,
        transform: Transform | None = None,
    ) -> None:
        """Read nothing yet.

        Args:
            frames: what to stream.
            seed: of the order, and with the position of the transform's random numbers.
            start: first position; all ranks together count positions from 0.
            epochs: passes over the frames; None never ends.
            shuffle: whether to shuffle; else the query's order.
            drives_together: with more drives, so many at a time are shuffled into one another, and
                the drives are shuffled: a store of a thousand is read with few files open.
            rank: of this process.
            world_size: number of such processes.
            transform: makes of each frame what is yielded; gets random numbers of its own.

        Raises:
            SettingsError: no place to start, no such rank, or no drive at a time.
        """
        super().__init__()
        if start < 0 or not 0 <= rank < world_size or drives_together < 1:
            raise SettingsError(
                f"a stream from position {start} of rank {rank} of {world_size}, {drives_together} "
                "drives together: positions and ranks count from 0, drives from 1"
            )
        self.frames = frames
        self.seed = seed
        self.start = start
        self.epochs = epochs
        self.shuffle = shuffle
        self.drives_together = drives_together
        self.rank = rank
        self.world_size = world_size
        self.transform = transform

    def __len__(self) -> int:
        """Samples left for this rank, over all epochs; endless streams have no length."""
        if self.epochs is None:
            raise TypeError("an endless stream has no length")
        left = max(len(self.frames) * self.epochs - self.start - self.rank, 0)
        return -(-left // self.world_size)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield samples; see the class."""
        worker = get_worker_info()
        workers, number = (worker.num_workers, worker.id) if worker else (1, 0)
        position = self.start + number * self.world_size + self.rank
        end = None if self.epochs is None else len(self.frames) * self.epochs
        epoch, order = -1, np.empty(0, np.int64)
        while end is None or position < end:
            if position // len(self.frames) != epoch:
                epoch = position // len(self.frames)
                order = self._order(epoch)
            yield self.sample(int(order[position % len(self.frames)]), position)
            position += workers * self.world_size

    def sample(self, number: int, position: int) -> dict[str, Any]:
        """Return one frame as it is streamed at a position."""
        sample = self.frames[number]
        if self.transform is not None:
            sample = self.transform(sample, np.random.default_rng([self.seed, position]))
        return {**sample, "position": position}

    def _order(self, epoch: int) -> Any:
        if not self.shuffle:
            return np.arange(len(self.frames))
        rng = np.random.default_rng([self.seed, epoch, 1])
        mixed = rng.permutation(len(self.frames))
        drives = self.frames.drives()
        places = rng.permutation(int(drives.max()) + 1)
        together = places[drives[mixed]] // self.drives_together
        return mixed[np.argsort(together, kind="stable")]


def torch_dataset(
    store: str,
    query: str,
    *,
    snapshot: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    **stream: Any,
) -> FrameStream:
    """Return the frames of a query as a torch IterableDataset.

    Args:
        store: folder or URL of the store.
        query: name of a file of `queries/training/`, a path, or SQL: one row a frame, with the
            columns dataset, sequence and frame; its `-- reads:` line names what is read for each.
        snapshot: a frozen list of files; those of this moment when None.
        parameters: values of the query's variables.
        **stream: seed, start, epochs, shuffle, rank, world_size and transform of `FrameStream`.

    Raises:
        TcrdataError: the store, the query or the snapshot is not there, or no frame comes of it.
    """
    opened = open_store(store)
    frames = open_frames(opened, query, snapshot=snapshot, parameters=parameters)
    return FrameStream(frames, **stream)
