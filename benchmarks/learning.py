"""Our detector beside the released one: time an iteration, memory, scores in equal time.

Run: python benchmarks/learning.py --store STORE
     python benchmarks/learning.py --store STORE --seconds 100 --root LATER --frames 100-124

An iteration is forward, loss and backward on one thread, by the processor's clock, since others may
be at work. The released grid has 256 x 256 cells of 0.125 m from above, 16 layers high. With --root
both are trained for the same processor time on the labels of STORE and then detect alone, without
any cue of motion, on frames that they were not trained on.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
import torch

from tcrdata import registry
from tcrdata.cli.selected import selected
from tcrdata.evaluation.protocol import Settings
from tcrdata.evaluation.scoring import evaluate
from tcrdata.networks.losses import detection_losses
from tcrdata.store import open_store

NETWORKS = ("birds_eye", "release_birds_eye")
GROUND = {"lateral_m": 16.0, "far_m": 32.0}
ITERATIONS, BATCH, WARM_STEPS = 6, 4, 4
SAMPLE_EVERY_S = 0.1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--store", required=True, help="a store with labels")
    parser.add_argument("--selection", default="tcrdata")
    parser.add_argument("--seconds", type=float, default=100.0, help="of each training")
    parser.add_argument("--dataset", default="kitti")
    parser.add_argument("--root", help="of the frames to detect on; none: no training is compared")
    parser.add_argument("--frames", default="all")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"load {os.getloadavg()[0]:.1f}\n")
    iterations()
    peak = training_mb(asked.store, asked.selection)
    print(f"\npeak memory of `tcrdata train detector` and its loader: {peak:,.0f} MB")
    if asked.root:
        equal_time(asked)


def iterations() -> None:
    """Seconds an iteration of one frame on the ground that the released code covers."""
    ours, released = (registry.find("networks", name) for name in NETWORKS)
    cases = {
        "ours, its own cells": (ours, ours.Settings(**GROUND)),
        "ours, the released cells": (ours, ours.Settings(**GROUND, cell_m=0.125, slices=16)),
        "released": (released, released.Settings()),
    }
    row("network", "cells", "parameters", "s an iteration", "released / this")
    row(*["---"] * 5)
    # In turns, so that all meet the same load.
    times = {name: float("inf") for name in cases}
    for _ in range(2):
        for name, (module, settings) in cases.items():
            times[name] = min(times[name], iteration_s(module, settings, 1))
    for name, (module, settings) in cases.items():
        region, network = settings.region, module.make_network(settings)
        size = sum(parameter.numel() for parameter in network.parameters())
        ratio = times["released"] / times[name]
        cells = f"{region.rows} x {region.columns}"
        row(name, cells, f"{size:,}", f"{times[name]:.3f}", f"{ratio:.1f}")


def iteration_s(module: Any, settings: Any, batch: int) -> float:
    """Least processor seconds of an iteration."""
    network = module.make_network(settings).to(memory_format=torch.channels_last)
    layers = next(network.parameters()).shape[1]
    region = settings.region
    image = torch.rand(batch, layers, region.rows, region.columns)
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


def training_mb(store: str, selection: str) -> float:
    """Peak memory of a training of default size, the loader's processes included."""
    with tempfile.TemporaryDirectory() as folder:
        own = copied(store, Path(folder))
        words = ["train", "detector", "--store", own, "--selection", selection]
        words += ["--set", "steps=8", "--set", "checkpoint_steps=4"]
        process = subprocess.Popen([sys.executable, "-m", "tcrdata", *words])
        peak = 0.0
        while process.poll() is None:
            peak = max(peak, tree_mb(process.pid))
            time.sleep(SAMPLE_EVERY_S)
        if process.returncode:
            raise SystemExit(f"the training failed with {process.returncode}")
        return peak


def tree_mb(pid: int) -> float:
    """Memory of a process and all below it; pages that several share count once."""
    try:
        root = psutil.Process(pid)
        family = (root, *root.children(recursive=True))
        return float(sum(process.memory_full_info().pss for process in family)) / 1e6
    except psutil.Error:
        return 0.0  # one ended while it was asked


def equal_time(asked: argparse.Namespace) -> None:
    """Train both for the same time and print what each detects on other frames."""
    print(f"\n{asked.seconds:g} s of training each, detections alone on frames {asked.frames}:\n")
    row("network", "steps", "AP per frame, all, bird's-eye, .3", ".5", ".7")
    row(*["---"] * 5)
    with tempfile.TemporaryDirectory() as folder:
        own, later = copied(asked.store, Path(folder)), str(Path(folder) / "later")
        for name in NETWORKS:
            module = registry.find("networks", name)
            steps = int(asked.seconds / iteration_s(module, module.Settings(), BATCH))
            sets = [f"network={name}", f"steps={steps}", f"batch={BATCH}"]
            words = ["train", "detector", "--store", own, "--selection", asked.selection, "--json"]
            model = json.loads(tcrdata(*words, *with_set(sets)))["model_id"]
            sets = [f"objectness3d.model={model}", f"objectness3d.model_store={own}"]
            frames = ["--root", asked.root, "--frames", asked.frames, "--store", later]
            words = ["build", "--dataset", asked.dataset, *frames, "--preset", "detector"]
            tcrdata(*words, *with_set(sets))
            row(name, str(steps), *(f"{ap:.2f}" for ap in ap_of(later)))


def ap_of(store: str) -> list[float]:
    """AP per frame over all objects, from above, at IoU .3, .5 and .7."""
    opened = open_store(store)
    result = evaluate(opened, selected(opened, None), Settings())
    found = result.find("all", "bev", "ap_per_frame")
    return [found[iou].value or 0.0 for iou in (0.3, 0.5, 0.7)]


def copied(store: str, folder: Path) -> str:
    """A copy of a store, so that no model lands in the user's."""
    shutil.copytree(store, folder / "store", dirs_exist_ok=True)
    return str(folder / "store")


def with_set(assignments: list[str]) -> list[str]:
    return [word for assignment in assignments for word in ("--set", assignment)]


def tcrdata(*arguments: str) -> str:
    command = [sys.executable, "-m", "tcrdata", *arguments]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(f"{' '.join(command)} failed: {run.stderr}")
    return run.stdout


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
