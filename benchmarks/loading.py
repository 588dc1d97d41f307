"""What the loader of trainings gives in a second, beside compressed npz files of the same arrays.

Run: python benchmarks/loading.py --store STORE

One store, one run, two processes for each: images, points and labels; optical flow, where the store
has any; what a detector learns from. Frames a second are wall time, of several passes the best.
Milliseconds are the processors', all processes together: they tell the same whoever else is at
work, and two processors cannot give more than 2000 / ms frames a second.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from torch.utils.data import DataLoader

from tcrdata.learning.frames import Frames, open_frames
from tcrdata.learning.runs import plan_recipe
from tcrdata.learning.stream import FrameStream, Transform
from tcrdata.store import open_store

LABELLED = """
-- reads: image, points
select f.dataset, f.sequence, f.frame, list({'box': [x_m, y_m, z_m, length_m, width_m, height_m,
                                                     yaw_rad], 'state': state}) as labels
from frames f join labels l using (dataset, sequence, frame)
where f.has_image
group by all order by all
"""
FLOWING = """
-- reads: flow
select dataset, sequence, frame from flows where direction = 'forward' order by all
"""
WORKERS, PASSES, REPEAT = 2, 4, 3
HEADER = ("samples", "from", "frames/s", "CPU ms a frame", "MB a frame on disk")


class NpzFiles:
    """One compressed file a frame, as the released code keeps them."""

    def __init__(self, paths: list[Path], passes: int) -> None:
        self.paths, self.passes = paths, passes

    def __len__(self) -> int:
        return len(self.paths) * self.passes

    def __getitem__(self, number: int) -> dict[str, Any]:
        with np.load(self.paths[number % len(self.paths)]) as file:
            return {name: file[name] for name in file.files}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--store", required=True)
    store = open_store(parser.parse_args().store)
    load = os.getloadavg()[0]
    print(f"{WORKERS} processes on {os.cpu_count()} processors, load {load:.1f}\n")
    row(*HEADER)
    row(*("---" for _ in HEADER))
    compare("image, points, labels", open_frames(store, LABELLED), labelled)
    if store.files("flows"):
        compare("flow", open_frames(store, FLOWING), flowing)
    recipe = plan_recipe("detector", {})
    frames = open_frames(store, recipe.query)
    row("detector's input and targets", "store", *measured(own(frames, recipe.transform)), "")


def compare(what: str, frames: Frames, transform: Transform) -> None:
    """Print a line for the store and one for npz files of the same arrays."""
    row(what, "store", *measured(own(frames, transform)), "")
    with tempfile.TemporaryDirectory() as folder:
        paths = [as_npz(frames, transform, n, Path(folder)) for n in range(len(frames))]
        size = sum(path.stat().st_size for path in paths) / len(paths) / 1e6
        row(what, "npz", *measured(lambda passes: NpzFiles(paths, passes)), f"{size:.2f}")


def own(frames: Frames, transform: Transform) -> Callable[[int], Any]:
    return lambda passes: FrameStream(frames, epochs=passes, transform=transform)


def labelled(sample: dict[str, Any], _: np.random.Generator) -> dict[str, Any]:
    boxes = np.array([label["box"] for label in sample["labels"]])
    names = ("image", "points", "reflectance")
    return {**{name: sample[name] for name in names}, "boxes": boxes}


def flowing(sample: dict[str, Any], _: np.random.Generator) -> dict[str, Any]:
    return {"flow": sample["flow"]}


def as_npz(frames: Frames, transform: Transform, number: int, folder: Path) -> Path:
    path = folder / f"{number}.npz"
    np.savez_compressed(path, **transform(frames[number], np.random.default_rng(0)))
    return path


def measured(samples: Callable[[int], Any]) -> tuple[str, str]:
    """Frames a second once all is running, and processor time a frame without the start's."""
    rates, costs = [], []
    for _ in range(REPEAT):
        count, _, start_cpu_s = drained(samples(1), 0)
        more, wall_s, cpu_s = drained(samples(1 + PASSES), count)
        rates.append((more - count) / wall_s)
        costs.append((cpu_s - start_cpu_s) / (more - count) * 1e3)
    return f"{max(rates):.0f}", f"{min(costs):.1f}"


def drained(samples: Any, first: int) -> tuple[int, float, float]:
    """Load all samples; return how many, wall seconds from the first-th on, processor seconds."""
    cpu, count, started = processors_s(), 0, time.perf_counter()
    for _ in DataLoader(samples, batch_size=None, num_workers=WORKERS):
        count += 1
        if count == first:
            started = time.perf_counter()
    return count, time.perf_counter() - started, processors_s() - cpu


def processors_s() -> float:
    """Processor seconds of this process and of those that it started and that ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
