"""Scores of tracking: overlap over time, first to last, identity, and return from occlusion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.identity import IdentitySums
from tcrdata.evaluation.series import TRUTH, SequenceSeries, Series, overlap, series_of
from tcrdata.evaluation.tracking_scores import (
    Curve,
    Ends,
    Recovery,
    TrackingEvaluation,
    TrackingSettings,
    describe_tracking,
)
from tcrdata.reports import run_report
from tcrdata.store import Store

STARTED = ("truth_tracklet", "truth_tracklet_library")
FOLLOWED = ("tracklet", "tracklet_library")
_SCORED_FOR_IDENTITY = ("label", *FOLLOWED)


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
        store: holds ground truth, and tracklets of the selection.
        selection_id: whose labels.
        settings: the protocol; None for the default one.

    Raises:
        MissingEvidenceError: nothing was tracked, or no sequence has labelled objects.
    """
    own = settings or TrackingSettings()
    sums = _Sums()
    identity, without_identity = _identity_sums()
    found: set[str] = set()
    for sequence in read_sequences(store, selection_id):
        found |= set(sequence.kinds)
        for kind in STARTED:
            _add_curves(sums, sequence, kind, own)
            _add_returns(sums, sequence, kind, own)
        for kind in (*STARTED, *FOLLOWED):
            sums.ends.setdefault(kind, []).append(_ends(sequence, kind, own))
        for part in identity.values():
            part.add(sequence)
    if not found & {*STARTED, *FOLLOWED}:
        raise MissingEvidenceError(
            f"nothing of selection {selection_id[:12]} was tracked yet: run `tcrdata track "
            f"--selection {selection_id[:12]}`, with `--init-from truth` for the overlap from a "
            "true first box, where one is in view"
        )
    return TrackingEvaluation(
        describe_tracking(own),
        tuple(_curve(key, values) for key, values in sums.curves.items()),
        tuple(_ends_score(kind, rows) for kind, rows in sums.ends.items() if kind in found),
        tuple(
            Recovery(kind, how, len(values), sum(values))
            for (kind, how), values in sorted(sums.returns.items())
        ),
        tuple(part.scores() for kind, part in identity.items() if kind in found),
        without_identity,
    )


def _identity_sums() -> tuple[dict[str, IdentitySums], str | None]:
    """Return sums for each kind, or none and why: the other scores do without the package."""
    try:
        return {kind: IdentitySums(kind) for kind in _SCORED_FOR_IDENTITY}, None
    except MissingEvidenceError as error:
        return {}, str(error)


def read_sequences(store: Store, selection_id: str) -> Iterator[SequenceSeries]:
    """Yield every sequence with labelled objects, one at a time.

    Raises:
        MissingEvidenceError: no sequence has any, or there is no such selection.
    """
    if not store.read("selections", columns=["round"], selection_id=selection_id).num_rows:
        raise MissingEvidenceError(f"there is no selection '{selection_id}'")
    tables = ("ground_truth", "labels", "tracklets", "truth_tracklets", "frames", "sequences")
    connection = store.connect(tables=tables)
    try:
        keys = run_report(connection, "tracking_sequences").fetchall()
        if not keys:
            raise MissingEvidenceError(
                "no sequence of this store has labelled objects to score with: build with ground "
                "truth beside the data"
            )
        for dataset, sequence in keys:
            parameters = {
                "selection_id": selection_id,
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
        owner = _owner(sequence, tracklet, 0, own)
        begun_on = _truth_of(sequence, owner)
        if begun_on is not None:
            # An object may be labelled in fewer frames than it is there.
            end = int(np.searchsorted(tracklet.frames, begun_on.frames[-1], side="right")) - 1
            begun += 1
            kept += owner == _owner(sequence, tracklet, end, own)
    return objects, held, throughout, begun, kept


def _starts_on(tracklet: Series, truth: Series, first: int, own: TrackingSettings) -> bool:
    """Whether a tracklet is on an object in its first frame, or began with its true box."""
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
        for how, frame in _returned(truth, int(tracklet.frames[0]), own):
            on_it = overlap(tracklet, truth, frame) >= own.iou
            sums.returns.setdefault((kind, how), []).append(on_it)


def _returned(truth: Series, start: int, own: TrackingSettings) -> list[tuple[str, int]]:
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
            how = "contained" if any(truth.contained[gone : place + 1]) else "behind"
            result.append((how, int(truth.frames[asked])))
    return result
