"""Scores of tracking as rows of the table `metrics`, beside those of labels."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from tcrdata.evaluation.identity import IdentityScores
from tcrdata.evaluation.scoring import ALL, Score
from tcrdata.evaluation.tracking_scores import TrackingEvaluation, TrackingSettings
from tcrdata.store import Store, Unit
from tcrdata.store.followed import TRACKED, stage_of

STAGE = "tracking_metrics"
NO_THRESHOLD = 0.0
_MEANS = {"hota": "hota", "detection": "det_a", "association": "ass_a", "motp": "motp"}


def store_tracking_metrics(
    store: Store,
    selection_id: str,
    evaluation: TrackingEvaluation,
    settings: TrackingSettings,
    round_number: int,
) -> None:
    """Write the scores as rows of `metrics`, a unit of their own; the same scores only once.

    `metric` is `<kind of tracklet>.<score>`, such as `tracklet_library.recall_first_to_last` or
    `truth_tracklet.overlap_19` (mean overlap 19 frames after a true first box); view is bev, `iou`
    the threshold, 0 where there is none.

    Args:
        store: gets the rows.
        selection_id: whose labels were tracked.
        evaluation: of `evaluate_tracking`.
        settings: that it was made with.
        round_number: EM round of the selection.
    """
    rows = [asdict(score) for score in tracking_scores(evaluation, settings)]
    columns: dict[str, list[Any]] = {
        name: [row[name] for row in rows] for name in Score.__dataclass_fields__
    }
    columns["selection_id"] = [selection_id] * len(rows)
    stages = {stage_of(kind, selection_id) for kind in TRACKED}
    inputs = {
        str(record.unit): record.digest for record in store.records() if record.unit.stage in stages
    }
    text = json.dumps(asdict(settings), sort_keys=True)
    with store.writer(
        Unit(STAGE, "_", selection_id, round_number),
        settings_hash=hashlib.sha256(text.encode()).hexdigest(),
        # Whether TrackEval is there decides which rows there are.
        inputs={**inputs, "identity": str(not evaluation.without_identity)},
    ) as writer:
        writer.append("metrics", columns)


def tracking_scores(evaluation: TrackingEvaluation, settings: TrackingSettings) -> Iterator[Score]:
    """Yield every number of an evaluation, over all sequences."""
    for curve in evaluation.curves:
        subset = "moving" if curve.subset == "moved" else "all"
        for step, (value, objects) in enumerate(zip(curve.iou, curve.objects, strict=True)):
            name = f"{curve.kind}.overlap_{step:02d}"
            yield _score(name, value, objects, objects, NO_THRESHOLD, subset)
    for ends in evaluation.ends:
        named = {
            "recall_first_to_last": ends.recall,
            "recall_throughout": ends.recall_throughout,
            "precision_first_to_last": ends.precision,
        }
        for name, value in named.items():
            yield _score(
                f"{ends.kind}.{name}", value, ends.tracklets, ends.objects, settings.iou, "all"
            )
    for back in evaluation.recoveries:
        value = back.recovered / back.returns if back.returns else None
        name = f"{back.kind}.recovered_{back.how}"
        yield _score(name, value, back.recovered, back.returns, settings.iou, "all")
    for identity in evaluation.identity:
        yield from _identity_scores(identity, settings)


def _identity_scores(own: IdentityScores, settings: TrackingSettings) -> Iterator[Score]:
    for field, name in _MEANS.items():
        threshold = settings.iou if name == "motp" else NO_THRESHOLD
        value = getattr(own, field)
        yield _score(f"{own.kind}.{name}", value, own.boxes, own.truths, threshold, "all")
    for name in ("mota", "idf1", "switches"):
        value = float(getattr(own, name))
        yield _score(f"{own.kind}.{name}", value, own.boxes, own.truths, settings.iou, "all")


def _score(
    metric: str, value: float | None, predictions: int, truths: int, iou: float, subset: Any
) -> Score:
    return Score(ALL, ALL, subset, "bev", metric, iou, False, value, predictions, truths)
