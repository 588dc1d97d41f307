"""Measures the long range: 10,000 paths of 20 steps, scored in volumes of p; or whole trackings.

Run as `python benchmarks/tracking.py`. The figure is the least of several runs, beside that of a
loop over numpy's own trilinear sampling in the same process. With `--store`, which may be given
several times, `tcrdata track` runs on a copy of each in a process of its own: seconds and peak
memory; stores of a short and a long sequence side by side show whether it grows with the length.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates
from stages import watched

from tcrdata.store import open_store
from tcrdata.tracking.cell_points import cell_points
from tcrdata.tracking.long_range import Volume, score_paths
from tcrdata.tracking.scenes import Candidates, Scene
from tcrdata.types import FloatArray


class Nowhere:
    """A view that shows nothing: no path leaves the volumes."""

    origin = np.zeros(3)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ranges, and that no ray is in view."""
        return np.linalg.norm(points, axis=1), np.full(len(points), np.nan)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=10_000)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--store", action="append", default=[], help="track a copy of this store")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    for store in given.store:
        track(store, given.workers)
    if given.store:
        return
    random = np.random.default_rng(0)
    values = random.random((given.steps, 64, 12, 64)).astype(np.float32)
    nothing = Candidates(np.zeros((0, 7)), np.zeros(0), np.zeros(0, dtype=bool), ())
    empty = np.zeros((0, 3), np.float32)
    scene = Scene(0, cell_points(empty), empty, nothing, Nowhere())
    volumes = [Volume(v, np.zeros(3), 0.4, scene, 0.2) for v in values]
    shape = (given.paths, given.steps, 3)
    paths = (random.random(shape) * np.array([62.0, 10.0, 62.0]) * 0.4).astype(np.float32)

    def sampled() -> FloatArray:
        parts = [map_coordinates(v, paths[:, t].T / 0.4, order=1) for t, v in enumerate(values)]
        return np.asarray(np.mean(parts, axis=0))

    scores = score_paths(paths, volumes)
    np.testing.assert_allclose(scores, sampled(), atol=1e-4)
    ours = least_seconds(lambda: score_paths(paths, volumes), given.runs)
    theirs = least_seconds(sampled, given.runs)
    print(f"{given.paths:,} paths x {given.steps} steps: {1e3 * ours:.1f} ms of CPU time, "
          f"scipy's map_coordinates {1e3 * theirs:.1f} ms, ratio {theirs / ours:.1f}")  # fmt: skip


def track(store: str, workers: int) -> None:
    """Print seconds and peak memory, of all processes, of a tracking of a copy, and of none then.

    What a second run takes, which finds everything done, is start-up.
    """
    frames = open_store(store).read("frames", columns=["frame"]).num_rows
    with tempfile.TemporaryDirectory() as folder:
        copy = str(Path(folder) / "store")
        shutil.copytree(store, copy)
        command = [sys.executable, "-m", "tcrdata", "track", "--store", copy]
        for what in ("tracked", "nothing to do"):
            started = time.perf_counter()
            child = subprocess.Popen(
                [*command, "--workers", str(workers)], stderr=subprocess.DEVNULL
            )
            peak_mb = watched(child)
            wall = time.perf_counter() - started
            print(f"{store}: {frames} frames {what}: {wall:.1f} s, peak {peak_mb:.0f} MB")


def least_seconds(function: Callable[[], object], runs: int) -> float:
    """Return the least CPU time of some runs: others may use the machine meanwhile."""
    times = []
    for _ in range(runs):
        started = time.process_time()
        function()
        times.append(time.process_time() - started)
    return min(times)


if __name__ == "__main__":
    main()
