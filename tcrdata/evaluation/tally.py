"""Adds up matched frames into average precision, precision and recall."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from tcrdata.evaluation.ap import average_precision
from tcrdata.types import BoolArray, FloatArray


@dataclass
class Tally:
    """Frames of one view and subset, at T thresholds.

    Attributes:
        thresholds: T.
        truths: labelled objects so far.
        frame_ap: T lists, one number a frame that has labels or objects.
        scores: a frame an array, (N,).
        hits: a frame an array, (T, N): the label found an object.
        left_out: a frame an array, (T, N): the label is neither right nor wrong.
    """

    thresholds: int
    truths: int = 0
    frame_ap: list[list[float]] = field(default_factory=list)
    scores: list[FloatArray] = field(default_factory=list)
    hits: list[BoolArray] = field(default_factory=list)
    left_out: list[BoolArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.frame_ap = [[] for _ in range(self.thresholds)]

    def add(self, scores: FloatArray, hits: BoolArray, left_out: BoolArray, truths: int) -> None:
        """Add a frame."""
        self.truths += truths
        self.scores.append(scores)
        self.hits.append(hits)
        self.left_out.append(left_out)
        for level, of_frames in enumerate(self.frame_ap):
            keep = ~left_out[level]
            value = average_precision(scores[keep], hits[level][keep], truths)
            if value is not None:
                of_frames.append(value)

    def merge(self, other: Tally) -> None:
        """Add the frames of another tally."""
        self.truths += other.truths
        self.scores += other.scores
        self.hits += other.hits
        self.left_out += other.left_out
        for mine, theirs in zip(self.frame_ap, other.frame_ap, strict=True):
            mine += theirs

    def columns(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Return scores (N,), hits (T, N) and whether a label counts (T, N), over all frames."""
        empty = np.empty((self.thresholds, 0), dtype=bool)
        return (
            np.concatenate([np.empty(0), *self.scores]),
            np.concatenate([empty, *self.hits], axis=1),
            ~np.concatenate([empty, *self.left_out], axis=1),
        )

    def result(self) -> Result:
        """Return the scores at each threshold."""
        scores, hits, keep = self.columns()
        found = [int(np.count_nonzero(h & k)) for h, k in zip(hits, keep, strict=True)]
        predictions = [int(np.count_nonzero(k)) for k in keep]
        return Result(
            ap_per_frame=[_mean(values) for values in self.frame_ap],
            ap_pooled=[
                average_precision(scores[k], h[k], self.truths)
                for h, k in zip(hits, keep, strict=True)
            ],
            precision=[f / n if n else None for f, n in zip(found, predictions, strict=True)],
            recall=[f / self.truths if self.truths else None for f in found],
            predictions=predictions,
            truths=self.truths,
        )


@dataclass(frozen=True)
class Result:
    """Scores at each threshold, in [0, 1]; None where there is nothing to score.

    Attributes:
        ap_per_frame: mean over frames.
        ap_pooled: over all frames as one list.
        precision: share of the labels that found an object.
        recall: share of the objects that were found.
        predictions: labels scored.
        truths: labelled objects scored.
    """

    ap_per_frame: list[float | None]
    ap_pooled: list[float | None]
    precision: list[float | None]
    recall: list[float | None]
    predictions: list[int]
    truths: int


def merged(tallies: Iterable[Tally], thresholds: int) -> Tally:
    """Return the sum of tallies."""
    total = Tally(thresholds)
    for tally in tallies:
        total.merge(tally)
    return total


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
