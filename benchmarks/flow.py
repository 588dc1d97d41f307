"""Endpoint error and time of the flow estimator on pairs with known flow.

Run: `python benchmarks/flow.py FOLDER`, with FOLDER/kitti/{frame1,frame2,flow_gt}.png and
FOLDER/flying_chairs/{number}-{img0.ppm,img1.ppm,gt.flo}.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from tcrdata.evidence.flow import dis_flow
from tcrdata.evidence.flow_cycle import measure
from tcrdata.types import BoolArray, Float32Array, ImageArray


class FlowPair(NamedTuple):
    """Two grey images and the flow between them, where it is known."""

    name: str
    first: ImageArray
    second: ImageArray
    truth: Float32Array
    valid: BoolArray


def kitti_pairs(folder: Path) -> Iterator[FlowPair]:
    encoded = np.asarray(cv2.imread(str(folder / "flow_gt.png"), cv2.IMREAD_UNCHANGED))
    blue, green, red = (encoded[..., i].astype(np.float32) for i in range(3))
    truth = ((np.stack([red, green], axis=2) - 2**15) / 64).astype(np.float32)
    yield FlowPair(
        "kitti", grey(folder / "frame1.png"), grey(folder / "frame2.png"), truth, blue > 0
    )


def chairs_pairs(folder: Path) -> Iterator[FlowPair]:
    for path in sorted(folder.glob("*-gt.flo")):
        stem = path.name.removesuffix("-gt.flo")
        truth = np.asarray(cv2.readOpticalFlow(str(path)), dtype=np.float32)
        first, second = (grey(folder / f"{stem}-img{i}.ppm") for i in (0, 1))
        valid = np.isfinite(truth[..., 0]) & np.isfinite(truth[..., 1])
        yield FlowPair(f"chairs {stem}", first, second, truth, valid)


def grey(path: Path) -> ImageArray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def seconds(pair: FlowPair, repeats: int = 5) -> float:
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        dis_flow(pair.first, pair.second)
        best = min(best, time.perf_counter() - start)
    return best


def report(pair: FlowPair) -> str:
    flow, back = dis_flow(pair.first, pair.second), dis_flow(pair.second, pair.first)
    error = np.linalg.norm(flow - pair.truth, axis=2)
    length = np.linalg.norm(pair.truth, axis=2)[pair.valid]
    checked = error[pair.valid & measure(flow, back).paper]
    error = error[pair.valid]
    height, width = pair.first.shape
    return (
        f"| {pair.name} | {width}x{height} | {np.median(length):.1f} | {error.mean():.2f} "
        f"| {np.median(error):.2f} | {(error > 3).mean():.2f} | {len(checked) / len(error):.2f} "
        f"| {checked.mean():.2f} | {np.median(checked):.2f} | {seconds(pair):.3f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    cv2.setNumThreads(1)
    print(
        "| pair | size | median flow px | mean error px | median | share > 3 px "
        "| cycle-consistent share | its mean error | median | s, best of 5 |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for pair in (*kitti_pairs(folder / "kitti"), *chairs_pairs(folder / "flying_chairs")):
        print(report(pair))


if __name__ == "__main__":
    main()
