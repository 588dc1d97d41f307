"""Endpoint error of flow estimators on pairs with known flow, and the time of a pair, both ways.

Run: `python benchmarks/flow.py FOLDER [--weights FILE]`, with pairs of KITTI, FlyingChairs or
Middlebury below FOLDER; each estimator runs in turn on each pair, on one thread.
"""

from __future__ import annotations

import argparse
import time

import torch

from tcrdata.datasets.flow_pairs import find_flow_pairs
from tcrdata.evaluation.flow import flow_score
from tcrdata.evidence.flow_cycle import measure
from tcrdata.evidence.flow_estimators import Dis, Estimator, Raft
from tcrdata.flow_models import named_estimator
from tcrdata.networks.raft import Settings, make_network
from tcrdata.networks.trained import to_bytes
from tcrdata.types import ImageArray


def seconds(estimator: Estimator, first: ImageArray, second: ImageArray, repeats: int) -> float:
    """Processor time, the best of some: other jobs do not count."""
    best = float("inf")
    for _ in range(repeats):
        start = time.process_time()
        estimator.both_ways(first, second)
        best = min(best, time.process_time() - start)
    return best


def untrained(iterations: int) -> Raft:
    """RAFT with random weights: as fast as with learnt ones."""
    torch.manual_seed(0)
    state = make_network(Settings()).state_dict()
    return Raft("random", '{"size": "small"}', to_bytes(state), iterations)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder")
    parser.add_argument("--weights")
    parser.add_argument("--iterations", type=int, default=8)
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    raft = (
        named_estimator("raft", given.weights, None, None, given.iterations)
        if given.weights
        else untrained(given.iterations)
    )
    print("| pair | size | flow | EPE px | Fl | consistent | EPE there | processor s both ways |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    for pair in find_flow_pairs(given.folder):
        first, second = pair.read_images()
        for estimator in (Dis(), raft):
            flow, back = estimator.both_ways(first, second)
            truth = pair.read_truth(first.shape)
            score = flow_score(flow, measure(flow, back).paper, truth)
            height, width = first.shape[:2]
            numbers = (
                score.epe_px, score.outlier_share, score.consistent_share, score.epe_consistent_px,
                seconds(estimator, first, second, given.repeats),
            )  # fmt: skip
            shown = " | ".join("-" if value is None else f"{value:.3f}" for value in numbers)
            print(f"| {pair.group} {pair.name} | {width}x{height} | {estimator.method} | {shown} |")


if __name__ == "__main__":
    main()
