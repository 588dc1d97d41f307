"""Executors: order, bounds, errors, and no orphans."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tcrdata import __main__, executors
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


def test_workers_have_one_thread_whoever_started_their_server() -> None:
    code = (
        "import multiprocessing, os\n"
        "from tcrdata.executors import Processes\n"
        "if __name__ == '__main__':\n"
        "    multiprocessing.get_context('forkserver').Process(target=print).start()\n"
        "    with Processes(1) as parallel:\n"
        "        print(*parallel(os.getenv, ['OMP_NUM_THREADS', 'NUMBA_NUM_THREADS']))\n"
    )
    environment = {name: text for name, text in os.environ.items() if "THREADS" not in name}
    out = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert out.split() == ["1", "1"]


def test_an_error_in_a_worker_arrives_as_it_is() -> None:
    with Processes(2) as parallel, pytest.raises(FrameError, match="frame 3: no points"):
        list(parallel(fail, range(10)))


def test_a_killed_worker_is_an_error_that_says_so() -> None:
    with Processes(2) as parallel, pytest.raises(EvidenceError, match="worker process was killed"):
        list(parallel(die, range(4)))


def gone(process: int) -> bool:
    """Whether a process ends within 10 s."""
    for _ in range(100):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


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
    assert gone(worker)


def session(leader: int) -> list[int]:
    """Processes of a session: the sixth field of a process's state says which."""
    found = []
    for state in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = state.read_text().rpartition(")")[2].split()
            found += [int(state.parent.name)] if fields[3] == str(leader) else []
    return [process for process in found if process != leader]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are listed in /proc")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_outlives_a_training_that_is_stopped(how: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tcrdata", "train", "flow", "--from-scratch", "--store"]
    parent = subprocess.Popen(
        [*command, str(tmp_path / "store")], stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    # The keeper of resources, the server, and the worker that it forks.
    while len(session(parent.pid)) < 3 and parent.poll() is None:
        time.sleep(0.1)
    parent.send_signal(how)
    _, said = parent.communicate(timeout=60)
    assert parent.returncode == {signal.SIGTERM: 143, signal.SIGKILL: -9}[how]
    assert ("stopped; what is done is kept" in said) == (how == signal.SIGTERM)
    assert all(gone(process) for process in session(parent.pid))


@pytest.mark.parametrize(
    ("arguments", "preload"),
    [
        (["build", "--dataset", "kitti"], "PRELOAD"),
        (["build", "--dry-run"], ""),
        (["build", "--workers=1"], ""),
        (["track", "--store", "s"], "TRACKING"),
        (["track", "--workers", "1"], ""),
        (["check", "--store", "build"], ""),
        ([], ""),
    ],
)
def test_the_server_starts_first_for_what_surely_has_workers(
    arguments: list[str], preload: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    assert __main__._preload(arguments) == preload
    assert not preload or getattr(executors, preload)


@pytest.mark.parametrize(("ended", "code"), [(None, 0), (3, 3), ("a message", 1)])
def test_the_command_leaves_at_once_with_its_code(ended: object, code: int) -> None:
    program = (
        "import atexit\n"
        "from tcrdata import __main__, cli\n"
        "def ends():\n"
        "    print('said')\n"
        f"    raise SystemExit({ended!r})\n"
        "cli.main = ends\n"
        "atexit.register(print, 'asked to be told')\n"
        "__main__.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, "said\nasked to be told\n")


def test_a_command_that_is_stopped_while_it_starts_says_so_in_a_line() -> None:
    code = (
        "import sys\n"
        "from tcrdata import __main__\n"
        "class Stopped:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'tcrdata.cli':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Stopped())\n"
        "sys.argv = ['tcrdata', 'models']\n"
        "__main__.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (130, "tcrdata: stopped\n")
