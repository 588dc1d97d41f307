"""Scores a selection of labels against the labelled objects, sequence by sequence."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import duckdb
import numpy as np

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.matching import UNMATCHED, match
from tcrdata.evaluation.objects import (
    FrameObjects,
    ScoredSequence,
    read_frames,
    scored_sequences,
)
from tcrdata.evaluation.overlap import bev_overlap, covered_share, image_overlap
from tcrdata.evaluation.protocol import Settings, View, describe
from tcrdata.evaluation.tally import Tally, merged
from tcrdata.reports import variables
from tcrdata.store import Store, Unit
from tcrdata.types import BoolArray, FloatArray, IntArray

Subset = Literal["all", "moving"]
SUBSETS: tuple[Subset, ...] = ("all", "moving")
METRICS = ("ap_per_frame", "ap_pooled", "precision", "recall")
ALL = "all"
_JUDGED = "judged"

Key = tuple[str, str, Subset, View, bool]


@dataclass(frozen=True)
class Score:
    """One number: a row of `metrics`, which documents the fields."""

    dataset: str
    sequence: str
    subset: Subset
    view: View
    metric: str
    iou: float
    dont_care: bool
    value: float | None
    predictions: int
    truths: int


@dataclass(frozen=True)
class Evaluation:
    """The scores of a selection.

    Attributes:
        selection_id: what was scored.
        protocol: how, in plain lines; print it first.
        frames: frames that were built, in the scored sequences.
        sequences: scored, as dataset/sequence.
        without_truth: sequences left out because nobody labelled them.
        scores: dataset and sequence `all` first, then each sequence.
    """

    selection_id: str
    protocol: str
    frames: int
    sequences: tuple[str, ...]
    without_truth: tuple[str, ...]
    scores: tuple[Score, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain lists, dicts, numbers and text."""
        content: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return content

    def find(
        self,
        subset: Subset,
        view: View,
        metric: str,
        *,
        dataset: str = ALL,
        sequence: str = ALL,
        dont_care: bool | None = None,
    ) -> dict[float, Score]:
        """Return IoU to score; without `dont_care`, the variant that the protocol reports."""
        wanted = (dataset, sequence, subset, view, metric)
        found: dict[float, Score] = {}
        for s in self.scores:
            same = (s.dataset, s.sequence, s.subset, s.view, s.metric) == wanted
            if same and dont_care in (None, s.dont_care):
                found.setdefault(s.iou, s)
        return found


@dataclass(frozen=True)
class Tallied:
    """Matched frames of a selection, by sequence, subset, view and DontCare variant.

    Attributes:
        selection_id: what was matched.
        protocol: how, in plain lines.
        labelled: the sequences that have labelled objects.
        without_truth: the others, as dataset/sequence.
        tallies: dataset, sequence, subset, view and whether DontCare counts, to the frames' sums.
    """

    selection_id: str
    protocol: str
    labelled: tuple[ScoredSequence, ...]
    without_truth: tuple[str, ...]
    tallies: Mapping[Key, Tally]


def evaluate(store: Store, selection_id: str, settings: Settings | None = None) -> Evaluation:
    """Score a selection.

    Args:
        store: holds `labels`, `frames`, `sequences` and `ground_truth`.
        selection_id: of the labels.
        settings: the protocol; None for the default one.

    Raises:
        MissingEvidenceError: there is no such selection, no built sequence has labelled objects,
            or none has speeds while moving objects alone are asked for.
        SettingsError: a parameter is unknown.
    """
    settings = settings or Settings()
    return scored(tally_selection(store, selection_id, settings), settings)


def tally_selection(
    store: Store, selection_id: str, settings: Settings, sequences: Collection[str] | None = None
) -> Tallied:
    """Match a selection's labels in every frame, or in some sequences; raises as `evaluate`."""
    connection = _connect(store, selection_id)
    try:
        labelled, without_truth = scored_sequences(connection)
        if sequences is not None:
            labelled = [entry for entry in labelled if entry.sequence in sequences]
        _check(labelled, settings)
        parameters = {**dict(settings.parameters), "selection_id": selection_id}
        tallies: dict[Key, Tally] = defaultdict(lambda: Tally(len(settings.ious)))
        for frame in read_frames(connection, labelled, parameters, settings.frames_a_pass):
            for subset, view, regions, counts in _score_frame(frame, settings):
                tallies[frame.dataset, frame.sequence, subset, view, regions].add(*counts)
        protocol = describe(settings, variables(connection))
    finally:
        connection.close()
    return Tallied(selection_id, protocol, tuple(labelled), tuple(without_truth), dict(tallies))


def scored(tallied: Tallied, settings: Settings) -> Evaluation:
    """Turn matched frames into scores; the settings must be those they were matched with."""
    return Evaluation(
        selection_id=tallied.selection_id,
        protocol=tallied.protocol,
        frames=sum(entry.frames for entry in tallied.labelled),
        sequences=tuple(f"{entry.dataset}/{entry.sequence}" for entry in tallied.labelled),
        without_truth=tallied.without_truth,
        scores=tuple(_scores(tallied.tallies, settings)),
    )


def store_metrics(
    store: Store, evaluation: Evaluation, settings: Settings, round_number: int
) -> None:
    """Write the scores as rows of `metrics`, a unit of their own."""
    record = store.record(Unit("selection", "_", evaluation.selection_id, round_number))
    text = json.dumps(asdict(settings), sort_keys=True)
    unit = Unit("metrics", "_", evaluation.selection_id, round_number)
    rows = [asdict(score) for score in evaluation.scores]
    columns = {name: [row[name] for row in rows] for name in Score.__dataclass_fields__}
    columns["selection_id"] = [evaluation.selection_id] * len(rows)
    with store.writer(
        unit,
        settings_hash=hashlib.sha256(text.encode()).hexdigest(),
        inputs={"selection": record.digest} if record else {},
    ) as writer:
        writer.append("metrics", columns)


def _connect(store: Store, selection_id: str) -> duckdb.DuckDBPyConnection:
    """Connect to the labels, the truth, and the frames that were there when it was selected.

    Frames that were built later have no labels because nobody judged them: they are not misses.
    """
    connection = store.connect(tables=("labels", "selections", "ground_truth"))
    row = connection.execute(
        "select snapshot from selections where selection_id = ?", [selection_id]
    ).fetchone()
    if row is None:
        connection.close()
        raise MissingEvidenceError(
            f"there is no selection '{selection_id}': make one with `tcrdata check`, or list them "
            'with `tcrdata sql "select selection_id, name from selections"`'
        )
    store.add_snapshot(connection, row[0], _JUDGED)
    for table in ("frames", "sequences"):
        connection.execute(f"create view {table} as from {_JUDGED}.{table}")
    return connection


def _check(labelled: list[ScoredSequence], settings: Settings) -> None:
    if not labelled:
        raise MissingEvidenceError(
            "no sequence of this store has labelled objects: build from a dataset with labels "
            "(KITTI: label_02 or tracklet_labels.xml), or look at the labels with `tcrdata sql`"
        )
    if settings.moving_only and not any(entry.known_speeds for entry in labelled):
        raise MissingEvidenceError(
            "no labelled object has a known speed (its dataset gives no poses, such as KITTI's "
            "oxts): evaluate without --moving-only"
        )


def _score_frame(
    frame: FrameObjects, settings: Settings
) -> Iterator[tuple[Subset, View, bool, tuple[FloatArray, BoolArray, BoolArray, int]]]:
    """Yield subset, view, whether DontCare counts, and what `Tally.add` takes."""
    use = np.ones(len(frame.scored), bool) if settings.leave_out_unscored else frame.scored
    scored, moving = frame.scored[use], frame.moving[use]
    covered = covered_share(frame.labels_2d, frame.dont_care_2d) >= settings.dont_care_share
    found = {view: _match(frame, view, use, settings) for view in ("bev", "2d")}
    for view, regions in settings.variants:
        matched = found[view] != UNMATCHED
        on_scored = matched & _at(scored, found[view])
        left_out = matched & ~on_scored
        if regions:
            left_out |= ~matched & covered
        counts = (frame.scores, on_scored, left_out, int(scored.sum()))
        yield "all", view, regions, counts
        on_moving = on_scored & _at(moving, found[view])
        others = left_out | (on_scored & ~on_moving)
        yield (
            "moving",
            view,
            regions,
            (frame.scores, on_moving, others, int((scored & moving).sum())),
        )


def _match(frame: FrameObjects, view: str, use: BoolArray, settings: Settings) -> IntArray:
    if view == "bev":
        overlap = bev_overlap(
            frame.labels,
            frame.truths[use],
            frame.rotations[use],
            frame.sizes[use],
            frame.yaw_observable[use],
        )
    else:
        overlap = image_overlap(frame.labels_2d, frame.truths_2d[use])
    return match(overlap, frame.scored[use], np.array(settings.ious))


def _at(flags: BoolArray, index: IntArray) -> BoolArray:
    """Look flags up; UNMATCHED is False."""
    return np.append(flags, False)[index]


def _scores(tallies: Mapping[Key, Tally], settings: Settings) -> Iterator[Score]:
    """Yield the rows: everything first, then each sequence."""
    thresholds = len(settings.ious)
    sequences = dict.fromkeys((key[0], key[1]) for key in tallies)
    for scope in [(ALL, ALL), *sequences]:
        members = sequences if scope == (ALL, ALL) else [scope]
        for view, regions in settings.variants:
            of_subset = {
                subset: merged(
                    (tallies[(*member, subset, view, regions)] for member in members), thresholds
                )
                for subset in SUBSETS
            }
            yield from _rows(scope, view, regions, of_subset, settings)


def _rows(
    scope: tuple[str, str],
    view: View,
    regions: bool,
    of_subset: Mapping[Subset, Tally],
    settings: Settings,
) -> Iterator[Score]:
    everything = of_subset["all"].result()
    for subset in SUBSETS[1:] if settings.moving_only else SUBSETS:
        result = of_subset[subset].result()
        for metric in METRICS:
            # A label that hits a parked object is not wrong: precision is always on all objects.
            source = everything if metric == "precision" else result
            values = getattr(source, metric)
            for level, iou in enumerate(settings.ious):
                yield Score(
                    *scope, subset, view, metric, iou, regions, values[level],
                    source.predictions[level], source.truths,
                )  # fmt: skip
