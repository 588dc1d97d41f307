"""Executors: order, bounds, errors, and no orphans."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from tcrdata.errors import EvidenceError, FrameError
from tcrdata.executors import Processes, Serial, executor


def square(value: int) -> int:
    return value * value


def fail(value: int) -> int:
    if value == 3:
        raise FrameError("frame 3: no points")
    return value


def die(value: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return value


def threads_allowed(_: int) -> str | None:
    return os.environ.get("OMP_NUM_THREADS")


def test_one_worker_is_inline() -> None:
    with executor(1) as parallel:
        assert isinstance(parallel, Serial)
        assert list(parallel(square, [1, 2])) == [1, 4]


def test_processes_keep_order_and_do_not_run_ahead() -> None:
    drawn: list[int] = []

    def items() -> Iterator[int]:
        for value in range(40):
            drawn.append(value)
            yield value

    with Processes(2) as parallel:
        results = parallel(square, items())
        assert [next(results) for _ in range(3)] == [0, 1, 4]
        assert len(drawn) <= 3 + 2 * parallel.workers + 1
        assert list(results) == [value * value for value in range(3, 40)]
        assert list(parallel(threads_allowed, [0])) == ["1"]


def test_an_error_in_a_worker_arrives_as_it_is() -> None:
    with Processes(2) as parallel, pytest.raises(FrameError, match="frame 3: no points"):
        list(parallel(fail, range(10)))


def test_a_killed_worker_is_an_error_that_says_so() -> None:
    with Processes(2) as parallel, pytest.raises(EvidenceError, match="worker process was killed"):
        list(parallel(die, range(4)))


def test_workers_end_with_a_killed_parent() -> None:
    code = (
        "import os, time\n"
        "from tcrdata.executors import Processes\n"
        "if __name__ == '__main__':\n"
        "    with Processes(1) as parallel:\n"
        "        for pid in parallel(eval, ['__import__(\"os\").getpid()']):\n"
        "            print(pid, flush=True)\n"
        "        time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    pytest.fail(f"worker {worker} outlived its parent by 10 s")
