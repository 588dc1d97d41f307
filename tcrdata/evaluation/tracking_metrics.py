"""Scores of tracking: overlap over time, first to last, identity, and return from occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.identity import IdentityScores, identity_scores
from tcrdata.evaluation.series import TRUTH, SequenceSeries, Series, overlap, series_of
from tcrdata.reports import run_report
from tcrdata.store import Store

STARTED = ("truth_tracklet", "truth_tracklet_library")
FOLLOWED = ("tracklet", "tracklet_library")
_SCORED_FOR_IDENTITY = ("label", *FOLLOWED)


@dataclass(frozen=True)
class TrackingSettings:
    """The protocol.

    Attributes:
        frames: overlap is reported for so many frames from the start.
        iou: overlap of a box that is on an object.
        returned_frames: after so many frames in sight again an object counts as recovered.
        hidden_px: fewer visible pixels than this are out of sight.
    """

    frames: int = 20
    iou: float = 0.5
    returned_frames: int = 3
    hidden_px: int = 50


@dataclass(frozen=True)
class Curve:
    """Mean overlap with the object that a tracklet began on.

    Attributes:
        kind: truth_tracklet or truth_tracklet_library.
        subset: all, or those that moved meanwhile.
        iou: mean overlap 0, 1, ... frames after the start; None where nothing is scored.
        objects: how many are scored at each.
    """

    kind: str
    subset: str
    iou: tuple[float | None, ...]
    objects: tuple[int, ...]


@dataclass(frozen=True)
class Ends:
    """Whether tracklets hold their object from the first to the last frame.

    Attributes:
        kind: which tracklets.
        recall: share of objects that one tracklet is on in the first and in the last frame.
        recall_throughout: the same, and in every scored frame between.
        precision: share of tracklets that end on the object that they began on.
        objects: scored.
        tracklets: that began on a labelled object.
    """

    kind: str
    recall: float | None
    recall_throughout: float | None
    precision: float | None
    objects: int
    tracklets: int


@dataclass(frozen=True)
class Recovery:
    """Objects that came back into sight.

    Attributes:
        kind: truth_tracklet or truth_tracklet_library.
        how: behind (passed behind another) or contained (inside another's box).
        returns: how often that happened.
        recovered: how often the tracklet was on the object some frames later.
    """

    kind: str
    how: str
    returns: int
    recovered: int


@dataclass(frozen=True)
class TrackingEvaluation:
    """All scores of tracking.

    Attributes:
        protocol: how it was scored, in plain lines.
        curves: overlap over time.
        ends: first to last.
        recoveries: after occlusions.
        identity: HOTA, CLEAR and identity scores.
    """

    protocol: str
    curves: tuple[Curve, ...]
    ends: tuple[Ends, ...]
    recoveries: tuple[Recovery, ...]
    identity: tuple[IdentityScores, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain lists, dicts, numbers and text."""
        return asdict(self)


@dataclass
class _Sums:
    """What is counted sequence by sequence."""

    curves: dict[tuple[str, str], list[list[float]]] = field(default_factory=dict)
    ends: dict[str, list[tuple[int, int, int, int, int]]] = field(default_factory=dict)
    returns: dict[tuple[str, str], list[bool]] = field(default_factory=dict)


def evaluate_tracking(
    store: Store, selection_id: str, settings: TrackingSettings | None = None
) -> TrackingEvaluation:
    """Score the tracklets of a store and the tracks of a selection's labels.

    Args:
        store: holds ground truth, and tracklets of the selection's round.
        selection_id: whose labels.
        settings: the protocol; None for the default one.

    Raises:
        MissingEvidenceError: nothing was tracked, no sequence has labelled objects, or the package
            of the identity scores is missing.
    """
    own = settings or TrackingSettings()
    sums, parts = _Sums(), {kind: [] for kind in _SCORED_FOR_IDENTITY}
    found: set[str] = set()
    for sequence in read_sequences(store, selection_id):
        found |= set(sequence.kinds)
        for kind in STARTED:
            _add_curves(sums, sequence, kind, own)
            _add_returns(sums, sequence, kind, own)
        for kind in (*STARTED, *FOLLOWED):
            if sequence.of(kind):
                sums.ends.setdefault(kind, []).append(_ends(sequence, kind, own))
        for kind, scores in parts.items():
            if sequence.of(kind):
                scores.append(sequence)
    if not found & {*STARTED, *FOLLOWED}:
        raise MissingEvidenceError(
            "nothing was tracked yet: run `tcrdata track`, and `tcrdata track --init-from truth` "
            "for the overlap from a true first box"
        )
    return TrackingEvaluation(
        _protocol(own),
        tuple(_curve(key, values) for key, values in sums.curves.items()),
        tuple(_ends_score(kind, rows) for kind, rows in sums.ends.items()),
        tuple(
            Recovery(kind, how, len(values), sum(values))
            for (kind, how), values in sorted(sums.returns.items())
        ),
        tuple(identity_scores(kind, own) for kind, own in parts.items() if own),
    )


def read_sequences(store: Store, selection_id: str) -> Any:
    """Yield every sequence with labelled objects, one at a time.

    Raises:
        MissingEvidenceError: no sequence has any, or there is no such selection.
    """
    rounds = store.read("selections", columns=["round"], selection_id=selection_id)
    if not rounds.num_rows:
        raise MissingEvidenceError(f"there is no selection '{selection_id}'")
    tables = ("ground_truth", "labels", "tracklets", "truth_tracklets", "frames", "sequences")
    connection = store.connect(tables=tables)
    try:
        keys = run_report(connection, "tracking_sequences").fetchall()
        if not keys:
            raise MissingEvidenceError("no sequence of this store has labelled objects")
        for dataset, sequence in keys:
            parameters = {
                "selection_id": selection_id,
                "tracked_round": rounds["round"][0].as_py(),
                "scored_dataset": dataset,
                "scored_sequence": sequence,
            }
            table = run_report(connection, "tracking_objects", parameters).to_arrow_table()
            yield series_of(dataset, sequence, table)
    finally:
        connection.close()


def _truth_of(sequence: SequenceSeries, object_id: str | None) -> Series | None:
    found = (truth for truth in sequence.of(TRUTH) if truth.name == object_id)
    return next(found, None)


def _add_curves(sums: _Sums, sequence: SequenceSeries, kind: str, own: TrackingSettings) -> None:
    for tracklet in sequence.of(kind):
        truth = _truth_of(sequence, tracklet.object_id)
        if truth is None:
            continue
        start = int(tracklet.frames[0])
        span = (truth.frames >= start) & (truth.frames < start + own.frames)
        moved = bool(truth.moving[span].any())
        for subset in ("all", "moved") if moved else ("all",):
            values = sums.curves.setdefault((kind, subset), [[] for _ in range(own.frames)])
            for place in np.flatnonzero(span & truth.scored):
                frame = int(truth.frames[place])
                values[frame - start].append(overlap(tracklet, truth, frame))


def _curve(key: tuple[str, str], values: list[list[float]]) -> Curve:
    means = tuple(float(np.mean(v)) if v else None for v in values)
    return Curve(*key, means, tuple(len(v) for v in values))


def _ends(
    sequence: SequenceSeries, kind: str, own: TrackingSettings
) -> tuple[int, int, int, int, int]:
    """Return objects, held at both ends, held throughout; tracklets on an object, that stay so."""
    objects = held = throughout = begun = kept = 0
    series = sequence.of(kind)
    for truth in sequence.of(TRUTH):
        frames = truth.frames[truth.scored]
        if len(frames) < 2:
            continue
        objects += 1
        first, last = int(frames[0]), int(frames[-1])
        best = [
            t for t in series
            if _starts_on(t, truth, first, own) and overlap(t, truth, last) >= own.iou
        ]  # fmt: skip
        held += bool(best)
        throughout += any(
            all(overlap(t, truth, int(f)) >= own.iou for f in frames if f >= t.frames[0])
            for t in best
        )
    for tracklet in series:
        first = _owner(sequence, tracklet, 0, own)
        truth = _truth_of(sequence, first)
        if truth is not None:
            # An object may be labelled in fewer frames than it is there.
            last = int(np.searchsorted(tracklet.frames, truth.frames[-1], side="right")) - 1
            begun += 1
            kept += first == _owner(sequence, tracklet, last, own)
    return objects, held, throughout, begun, kept


def _starts_on(tracklet: Series, truth: Series, first: int, own: TrackingSettings) -> bool:
    """Whether a tracklet is on an object in its first frame, or began with it as early as could be."""
    if tracklet.object_id is not None:
        return tracklet.object_id == truth.name
    return overlap(tracklet, truth, first) >= own.iou


def _owner(
    sequence: SequenceSeries, tracklet: Series, row: int, own: TrackingSettings
) -> str | None:
    """Return the labelled object that a tracklet's box is on, None for none."""
    frame = int(tracklet.frames[row])
    truths = sequence.of(TRUTH)
    overlaps = [overlap(tracklet, truth, frame) for truth in truths]
    best = int(np.argmax(overlaps)) if overlaps else 0
    return truths[best].name if overlaps and overlaps[best] >= own.iou else None


def _ends_score(kind: str, rows: Sequence[tuple[int, int, int, int, int]]) -> Ends:
    objects, held, throughout, begun, kept = np.sum(rows, axis=0).tolist()
    return Ends(
        kind,
        held / objects if objects else None,
        throughout / objects if objects else None,
        kept / begun if begun else None,
        objects,
        begun,
    )


def _add_returns(sums: _Sums, sequence: SequenceSeries, kind: str, own: TrackingSettings) -> None:
    for tracklet in sequence.of(kind):
        truth = _truth_of(sequence, tracklet.object_id)
        if truth is None or np.isnan(truth.visible_px).any():
            continue
        for how, frame in _returned(sequence, truth, int(tracklet.frames[0]), own):
            on_it = overlap(tracklet, truth, frame) >= own.iou
            sums.returns.setdefault((kind, how), []).append(on_it)


def _returned(
    sequence: SequenceSeries, truth: Series, start: int, own: TrackingSettings
) -> list[tuple[str, int]]:
    """Return how an object was hidden and the frame in which it is asked for, each time."""
    result = []
    hidden = truth.visible_px < own.hidden_px
    for place in np.flatnonzero(hidden[:-1] & ~hidden[1:]):
        asked = int(place) + own.returned_frames
        gone = int(place)
        while gone > 0 and hidden[gone - 1]:
            gone -= 1
        seen_before = gone > 0 and truth.frames[gone - 1] >= start
        in_sight = asked < len(hidden) and not hidden[place + 1 : asked + 1].any()
        if seen_before and in_sight:
            middle = (gone + int(place)) // 2
            how = "contained" if _is_contained(sequence, truth, middle) else "behind"
            result.append((how, int(truth.frames[asked])))
    return result


def _is_contained(sequence: SequenceSeries, truth: Series, row: int) -> bool:
    """Whether an object's centre lies in the box of another."""
    x, y, z = truth.boxes[row, :3]
    for other in sequence.of(TRUTH):
        there = other.at(int(truth.frames[row]))
        if other.name == truth.name or there < 0:
            continue
        box = other.boxes[there]
        c, s = np.cos(box[6]), np.sin(box[6])
        dx, dz = x - box[0], z - box[2]
        along, across = abs(c * dx - s * dz), abs(s * dx + c * dz)
        if along <= box[3] / 2 and across <= box[4] / 2 and abs(y - box[1]) <= box[5] / 2:
            return True
    return False


def _protocol(own: TrackingSettings) -> str:
    return "\n".join(
        (
            "Truth: labelled objects in frames that were built, inside the region of `evaluate`; "
            f"one that shows fewer than {own.hidden_px} pixels is hidden. Overlap: rotated "
            "footprints, as in `evaluate`.",
            f"Overlap over time: from the true first box, {own.frames} frames; frames in which the "
            "object is hidden or outside are left out, a tracklet that has ended scores 0.",
            f"First to last: recall = objects that one tracklet is on (IoU {own.iou}) in their "
            "first and last scored frame; precision = tracklets that end on the object that they "
            "began on, of those that began on any.",
            f"Recovered: IoU {own.iou} {own.returned_frames} frames after an object came back into "
            "sight.",
            "HOTA, CLEAR and identity: TrackEval's, on footprints; CLEAR and identity at IoU "
            f"{own.iou}. Boxes on hidden or outside objects, and outside the region, are left out.",
        )
    )
