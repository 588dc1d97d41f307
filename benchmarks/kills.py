"""Kills builds with -9 at random moments, resumes them, and compares every file they leave.

    python benchmarks/kills.py
    python benchmarks/kills.py --dataset kitti --root ROOT --frames 0-49

A reference is built in peace. Then builds of the same are killed, the command alone or with all its
workers, and started again on what they left, until each is done; done stores must be the reference
byte by byte, and after each kill what is visible must be files of the reference.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--dataset", default="street")
    parser.add_argument("--root", default="frames=10")
    parser.add_argument("--frames", default="all", help="ranges such as 0-49")
    parser.add_argument("--preset", default="tcrdata")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    build = [sys.executable, "-m", "tcrdata", "build", "--workers", "2", "--preset", asked.preset]
    build += ["--dataset", asked.dataset, "--root", asked.root, "--frames", asked.frames]
    with tempfile.TemporaryDirectory() as folder:
        kill_and_compare(build, Path(folder), asked.kills, random.Random(asked.seed))


def kill_and_compare(build: list[str], folder: Path, kills: int, moments: random.Random) -> None:
    """Kill that many builds; print what was compared and exit with 1 when anything differs."""
    started = time.perf_counter()
    start(build, folder / "reference").wait()
    seconds = time.perf_counter() - started
    reference = digests(folder / "reference")
    killed = compared = torn = stores = unlike = 0
    while killed < kills or stores == 0:
        store = folder / f"store_{stores}"
        while True:
            process = start(build, store)
            if killed < kills and died(process, moments, seconds):
                killed += 1
                left = digests(store)
                compared += len(left)
                torn += len(left.items() - reference.items())
                continue
            if process.wait() != 0:
                raise SystemExit(f"a resumed build ended with {process.returncode}")
            break
        stores += 1
        ended = digests(store)
        compared += len(ended)
        unlike += ended != reference
    print(f"{killed} kills, {stores} stores resumed to their end, a build takes {seconds:.1f} s")
    print(f"files compared: {compared}; torn: {torn}; stores unlike the reference: {unlike}")
    sys.exit(1 if torn or unlike else 0)


def start(build: list[str], store: Path) -> subprocess.Popen[bytes]:
    """Start a build in a process group of its own."""
    command = [*build, "--store", str(store)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)


def died(process: subprocess.Popen[bytes], moments: random.Random, seconds: float) -> bool:
    """Kill a build at a random moment, alone or with its workers; False when it was done before."""
    alone = moments.random() < 0.5
    time.sleep(moments.uniform(0.0, seconds))
    if process.poll() is not None:
        return False
    if alone:
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def digests(store: Path) -> dict[str, str]:
    """sha256 of every visible file of a store: what grows in `tmp/` is not."""
    return {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in store.rglob("*")
        if path.is_file() and path.relative_to(store).parts[0] != "tmp"
    }


if __name__ == "__main__":
    main()
