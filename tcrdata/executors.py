"""Where work runs: inline, or in worker processes. Results come in the order of the items."""

from __future__ import annotations

import multiprocessing
import multiprocessing.forkserver
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from types import TracebackType
from typing import TypeVar, cast

from tcrdata.errors import EvidenceError

T = TypeVar("T")
R = TypeVar("R")

PRELOAD = ("tcrdata.evidence.preloading", "tcrdata.datasets.kitti", "tcrdata.datasets.frame_counts")
"""Modules imported once, by the server that the workers are forked from."""

TRACKING = ("tcrdata.track_preloading", "tcrdata.datasets.kitti")
"""The same for workers that track."""

_ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "POLARS_MAX_THREADS",
    ),
    "1",
)
# Arrays of a sweep are freed and asked for again all the time: keep their pages.
_KEEP_PAGES = {"MALLOC_MMAP_THRESHOLD_": "67108864", "MALLOC_TRIM_THRESHOLD_": "134217728"}


class Serial:
    """Runs every item inline."""

    workers = 1

    def __call__(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Yield `function(item)` for each item."""
        return map(function, items)

    def __enter__(self) -> Serial:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class Processes:
    """Runs items in worker processes of one thread each, at most two items ahead a worker.

    The workers are forked from a server process that holds no threads, so that the libraries'
    thread pools of this process cannot deadlock them; they end when this process does, even
    when it is killed.
    """

    def __init__(self, workers: int, preload: Sequence[str] = PRELOAD) -> None:
        """Start no process yet.

        Args:
            workers: number of processes.
            preload: modules that the server imports, where it does not run yet.
        """
        self.workers = workers
        self._preload = preload
        self._pool: ProcessPoolExecutor | None = None

    def __call__(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Yield `function(item)` for each item, in order.

        Raises:
            EvidenceError: a worker was killed, by the system for want of memory or by hand.
        """
        pool = self._started()
        pending: deque[Future[R]] = deque()
        try:
            for item in items:
                pending.append(pool.submit(function, item))
                if len(pending) > 2 * self.workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        except BrokenProcessPool as error:
            self._pool = None
            raise EvidenceError(
                "a worker process was killed (out of memory?): run again with fewer --workers; "
                "what is done is kept"
            ) from error
        finally:
            for future in pending:
                future.cancel()

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def _started(self) -> ProcessPoolExecutor:
        if self._pool is None:
            start_server(self._preload)
            context = multiprocessing.get_context("forkserver")
            self._pool = ProcessPoolExecutor(
                self.workers, mp_context=context, initializer=_start_worker
            )
        return self._pool


def executor(workers: int) -> Serial | Processes:
    """Return the executor for a number of workers: inline for one."""
    return Serial() if workers <= 1 else Processes(workers)


def one_ahead(items: Iterator[T]) -> Iterator[T]:
    """Yield items, each made in a thread while the one before is worked on: two are held."""
    end = object()
    with ThreadPoolExecutor(max_workers=1) as beside:
        coming: Future[T | object] = beside.submit(next, items, end)
        while (item := coming.result()) is not end:
            coming = beside.submit(next, items, end)
            yield cast(T, item)


def start_server(preload: Sequence[str] = PRELOAD) -> None:
    """Start the server that workers are forked from, unless it runs; returns at once.

    It imports what the workers need while this process goes on: the earlier, the better.

    Args:
        preload: modules that it imports.
    """
    multiprocessing.get_context("forkserver").set_forkserver_preload(list(preload))
    # The server copies the environment when it starts, and the workers have the server's.
    with _environment({**_ONE_THREAD, **_KEEP_PAGES}):
        multiprocessing.forkserver.ensure_running()


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def end_with_parent(_: int = 0) -> None:
    """End this worker process when the one that it works for is gone, even when that was killed.

    Args:
        _: number of the worker, as loaders of data give it.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _start_worker() -> None:
    """Hold this worker to one thread, and to its parent's life.

    The server may have been started by another library, with an environment of its own.
    """
    os.environ.update(_ONE_THREAD)
    end_with_parent()
