"""HOTA (Luiten et al. 2021), CLEAR and identity scores, by the package trackeval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.series import TRUTH, SequenceSeries, frame_overlap

_IOU = 0.5


@dataclass(frozen=True)
class IdentityScores:
    """Scores of one kind of series against the labelled objects.

    Attributes:
        kind: label, tracklet or tracklet_library.
        hota: mean over overlaps .05 to .95.
        detection: DetA, the same mean.
        association: AssA, the same mean.
        mota: CLEAR accuracy.
        motp: CLEAR precision: mean overlap of what matches.
        idf1: identity F1.
        switches: identity switches.
        truths: labelled boxes.
        boxes: boxes scored.
    """

    kind: str
    hota: float
    detection: float
    association: float
    mota: float
    motp: float
    idf1: float
    switches: int
    truths: int
    boxes: int


class IdentitySums:
    """Scores of one kind of series, sequence by sequence: of each only its sums are kept."""

    def __init__(self, kind: str) -> None:
        """Start with no sequence.

        Raises:
            MissingEvidenceError: trackeval is not installed.
        """
        self._kind = kind
        self._metrics = _metrics()
        self._parts: dict[str, dict[str, Any]] = {name: {} for name in self._metrics}
        self._truths = self._boxes = 0

    def add(self, sequence: SequenceSeries) -> None:
        """Score one sequence more."""
        data = _arrays(sequence, self._kind)
        self._truths += data["num_gt_dets"]
        self._boxes += data["num_tracker_dets"]
        name = f"{sequence.dataset}/{sequence.sequence}"
        for metric, part in self._parts.items():
            part[name] = self._metrics[metric].eval_sequence(data)

    def scores(self) -> IdentityScores:
        """Return the scores over all sequences."""
        whole = {
            name: metric.combine_sequences(self._parts[name])
            for name, metric in self._metrics.items()
        }
        hota, clear, identity = whole["HOTA"], whole["CLEAR"], whole["Identity"]
        return IdentityScores(
            self._kind,
            float(np.mean(hota["HOTA"])),
            float(np.mean(hota["DetA"])),
            float(np.mean(hota["AssA"])),
            float(clear["MOTA"]),
            float(clear["MOTP"]),
            float(identity["IDF1"]),
            int(clear["IDSW"]),
            self._truths,
            self._boxes,
        )


def _metrics() -> dict[str, Any]:
    try:
        from trackeval import metrics
    except ModuleNotFoundError as error:
        raise MissingEvidenceError(
            "HOTA, CLEAR and identity scores need the package trackeval: "
            "pip install 'tcrdata[eval]'"
        ) from error
    quiet = {"PRINT_CONFIG": False, "THRESHOLD": _IOU}
    return {
        "HOTA": metrics.HOTA(),
        "CLEAR": metrics.CLEAR(quiet),
        "Identity": metrics.Identity(quiet),
    }


def _arrays(sequence: SequenceSeries, kind: str) -> dict[str, Any]:
    """Return one sequence as trackeval's metrics take it: ids from 0, overlaps frame by frame."""
    own, truths = sequence.of(kind), sequence.of(TRUTH)
    frames = sorted({int(f) for series in (*own, *truths) for f in series.frames})
    ids: list[list[tuple[int, int]]] = []
    overlaps = []
    for frame in frames:
        ours, theirs, shared = frame_overlap(own, truths, frame)
        scored = np.array([truths[n].scored[row] for n, row in theirs], dtype=bool)
        inside = np.array([own[n].scored[row] for n, row in ours], dtype=bool)
        kept = inside & ~_on_unscored(shared, scored)
        ids.append([(0, n) for (n, _), k in zip(theirs, scored, strict=True) if k])
        ids[-1] += [(1, n) for (n, _), k in zip(ours, kept, strict=True) if k]
        overlaps.append(shared[kept][:, scored].T)
    numbers: tuple[dict[int, int], dict[int, int]] = ({}, {})
    for group, n in (pair for frame_ids in ids for pair in frame_ids):
        numbers[group].setdefault(n, len(numbers[group]))
    split = [
        [
            np.array([numbers[g][n] for g, n in frame_ids if g == side], dtype=int)
            for frame_ids in ids
        ]
        for side in (0, 1)
    ]
    return {
        "gt_ids": split[0],
        "tracker_ids": split[1],
        "similarity_scores": overlaps,
        "num_timesteps": len(frames),
        "num_gt_ids": len(numbers[0]),
        "num_tracker_ids": len(numbers[1]),
        "num_gt_dets": int(sum(map(len, split[0]))),
        "num_tracker_dets": int(sum(map(len, split[1]))),
    }


def _on_unscored(shared: Any, scored: Any) -> Any:
    """Return which boxes lie on an object that is not scored, and on none that is."""
    if not shared.shape[1]:
        return np.zeros(len(shared), dtype=bool)
    best = np.where(scored, shared, 0.0).max(axis=1)
    other = np.where(scored, 0.0, shared).max(axis=1)
    return (other >= _IOU) & (best < _IOU)
