"""Flow scored against known flow: of pairs in a folder, of generated frames, of a store's rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from tcrdata import registry
from tcrdata.datasets.flow_pairs import find_flow_pairs
from tcrdata.errors import DatasetError, MissingEvidenceError
from tcrdata.evaluation.flow import FlowScore, flow_score
from tcrdata.evidence.flow_cycle import measure
from tcrdata.evidence.flow_estimators import Estimator
from tcrdata.evidence.stored_flow import StoredFlow, read_flow
from tcrdata.ingest import frames_of
from tcrdata.plan import ROUND
from tcrdata.store import Store
from tcrdata.types import BoolArray, Dataset, Float32Array, Frame


@dataclass(frozen=True)
class ScoredFlow:
    """One flow and its score.

    Attributes:
        group: folder or drive.
        name: of the pair.
        width_px: of the images.
        height_px: of the images.
        method: dis or raft.
        score: sums over its pixels.
    """

    group: str
    name: str
    width_px: int
    height_px: int
    method: str
    score: FlowScore


def score_folder(root: str, estimator: Estimator) -> Iterator[ScoredFlow]:
    """Estimate and score each pair below a folder; see `find_flow_pairs`.

    Raises:
        DatasetError: there is no pair, or one cannot be read.
    """
    for pair in find_flow_pairs(root):
        first, second = pair.read_images()
        flow, back = estimator.both_ways(first, second)
        truth = pair.read_truth(first.shape)
        yield _scored(
            pair.group, pair.name, estimator.method, flow, measure(flow, back).paper, truth
        )


def score_dataset(name: str, root: str, estimator: Estimator) -> Iterator[ScoredFlow]:
    """Estimate and score consecutive frames of a dataset that knows its flow exactly.

    Raises:
        DatasetError: it does not, or a frame cannot be read.
    """
    dataset = registry.find("datasets", name).open_dataset(root)
    for sequence in dataset.sequences():
        for start, end in pairwise(dataset.frames(sequence)):
            truth = _exact_flow(dataset, start, end)
            if truth is None:
                raise DatasetError(
                    f"no exact flow is known of {name}/{sequence}: give a generated dataset, clips "
                    "with their truth, or a folder of pairs as --root alone"
                )
            flow, back = estimator.both_ways(dataset.read_image(start), dataset.read_image(end))
            consistent = measure(flow, back).paper
            label = f"{start.frame} to {end.frame}"
            yield _scored(f"{name}/{sequence}", label, estimator.method, flow, consistent, truth)


def score_store(store: Store) -> Iterator[ScoredFlow]:
    """Score the forward flows of a store, against exact flow where the dataset knows it.

    Raises:
        MissingEvidenceError: the store has no flow.
        DatasetError: a generated frame cannot be made again.
    """
    columns = ["dataset", "sequence", "root"]
    drives = store.read("sequences", columns=columns, round=ROUND).to_pylist()
    found = False
    for drive in sorted(drives, key=lambda row: (row["dataset"], row["sequence"])):
        dataset = registry.find("datasets", drive["dataset"]).open_dataset(drive["root"])
        tables = store.tables(drive["dataset"], drive["sequence"], ROUND)
        usable = list(frames_of(store, drive["dataset"], drive["sequence"]))
        for start, end in pairwise(usable):
            stored = read_flow(tables, start, end)
            if stored is not None:
                found = True
                yield _scored_row(dataset, start, end, stored)
    if not found:
        raise MissingEvidenceError(
            f"{store.url}: no flow in it: build with a preset that measures it, such as paper"
        )


def _scored_row(dataset: Dataset, start: Frame, end: Frame, stored: StoredFlow) -> ScoredFlow:
    truth = _exact_flow(dataset, start, end)
    group, label = f"{start.dataset}/{start.sequence}", f"{start.frame} to {end.frame}"
    return _scored(group, label, stored.method, stored.decode(), stored.passes("paper"), truth)


def _exact_flow(dataset: Dataset, start: Frame, end: Frame) -> Float32Array | None:
    """Return the true flow between two frames; None where the dataset does not know it."""
    exact = getattr(dataset, "exact_flow", None)
    flow: Float32Array | None = exact(start, end) if exact else None
    return flow


def _scored(
    group: str,
    name: str,
    method: str,
    flow: Float32Array,
    consistent: BoolArray,
    truth: Float32Array | None,
) -> ScoredFlow:
    height, width = flow.shape[:2]
    score = flow_score(flow, consistent, truth)
    return ScoredFlow(group, name, width, height, method, score)
