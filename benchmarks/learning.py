"""Frames a second of the loader beside npz files, and seconds an iteration of the detectors.

Run: python benchmarks/learning.py --store STORE [--selection NAME]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import DataLoader

from tcrdata import registry
from tcrdata.learning.frames import Frames, open_frames
from tcrdata.learning.stream import FrameStream
from tcrdata.networks.losses import detection_losses
from tcrdata.store import open_store

QUERY = """
-- reads: image, points
select f.dataset, f.sequence, f.frame, list({'box': [x_m, y_m, z_m], 'state': state}) as labels
from frames f join labels l using (dataset, sequence, frame)
group by all order by all
"""
PASSES, WORKERS, BATCH, ITERATIONS = 3, 2, 1, 4


class NpzFiles:
    """One compressed file a frame, as the released code keeps them."""

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths

    def __len__(self) -> int:
        return len(self.paths) * PASSES

    def __getitem__(self, number: int) -> dict[str, Any]:
        with np.load(self.paths[number % len(self.paths)]) as file:
            return {name: file[name] for name in file.files}


def main() -> None:
    """Print each measurement as one line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", required=True)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    loading(arguments.store)
    iterating()


def loading(url: str) -> None:
    """Images, points and labels from the store and from npz files, with two processes."""
    frames = open_frames(open_store(url), QUERY)
    with tempfile.TemporaryDirectory() as folder:
        paths = [as_npz(frames, number, Path(folder)) for number in range(len(frames))]
        size = sum(path.stat().st_size for path in paths) / len(paths)
        npz = rate(lambda: DataLoader(NpzFiles(paths), batch_size=None, num_workers=WORKERS))
        own = rate(lambda: loader_of(frames))
    say(f"loader, {WORKERS} processes: image, points, labels", f"{own:.1f} frames/s")
    say(f"  npz files of {size / 1e6:.1f} MB", f"{npz:.1f} frames/s")


def loader_of(frames: Frames) -> DataLoader[dict[str, Any]]:
    stream = FrameStream(frames, epochs=PASSES, transform=plain)
    return DataLoader(stream, batch_size=None, num_workers=WORKERS)


def plain(sample: dict[str, Any], _: np.random.Generator) -> dict[str, Any]:
    """Leave out what is no array."""
    boxes = np.array([label["box"] for label in sample["labels"]])
    return {"image": sample["image"].copy(), "points": sample["points"].copy(), "boxes": boxes}


def as_npz(frames: Frames, number: int, folder: Path) -> Path:
    path = folder / f"{number}.npz"
    sample = plain(frames[number], np.random.default_rng(0))
    np.savez_compressed(path, **sample)
    return path


def rate(make: Callable[[], DataLoader[dict[str, Any]]]) -> float:
    """Frames a second, the start of the processes aside; the better of two."""
    return max(_rate(iter(make())) for _ in range(2))


def _rate(samples: Iterator[dict[str, Any]]) -> float:
    for _ in range(4):
        next(samples)
    started, count = time.perf_counter(), 0
    for _ in samples:
        count += 1
    return count / (time.perf_counter() - started)


def iterating() -> None:
    """Forward, loss and backward on the ground that the released code covers, one thread."""
    release = registry.find("networks", "release_birds_eye")
    times = {}
    for name, settings in (
        ("birds_eye", registry.find("networks", "birds_eye").Settings(lateral_m=16.0, far_m=32.0)),
        ("release_birds_eye", release.Settings()),
    ):
        times[name] = iteration(registry.find("networks", name), settings)
        say(f"an iteration of {name}, 32 x 32 m, batch {BATCH}", f"{times[name]:.3f} s")
    say("  ratio", f"{times['release_birds_eye'] / times['birds_eye']:.1f}")


def iteration(module: Any, settings: Any) -> float:
    """Best seconds of an iteration, by the processor's clock: others may be at work."""
    network = module.make_network(settings).to(memory_format=torch.channels_last)
    layers = network.stem[0][0].in_channels if module.__name__.endswith(".birds_eye") else 16
    region = settings.region
    image = torch.rand(BATCH, layers, region.rows, region.columns)
    image = image.contiguous(memory_format=torch.channels_last)
    targets = {name: torch.zeros_like(o) for name, o in network(image).items()}
    cells = torch.ones_like(targets["center"])
    weights = ("center_weight", "box_weight", "direction_weight")
    targets |= dict.fromkeys(weights, cells)
    if "segmentation" in targets:
        targets["segmentation_weight"] = torch.ones_like(targets["segmentation"])
    best = float("inf")
    for _ in range(ITERATIONS):
        started = time.process_time()
        loss = torch.stack(list(detection_losses(network(image), targets).values())).sum()
        loss.backward()
        best = min(best, time.process_time() - started)
    return best


def say(what: str, value: str) -> None:
    """Print one measurement."""
    print(f"{what:<60} {value}", flush=True)


if __name__ == "__main__":
    main()
