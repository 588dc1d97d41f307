"""Precision over recall of a selection, over all its labelled sequences together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.evaluation.ap import average_precision, precision_recall
from tcrdata.evaluation.protocol import Settings, View
from tcrdata.evaluation.scoring import SUBSETS, Subset, Tallied
from tcrdata.evaluation.tally import merged
from tcrdata.types import BoolArray, FloatArray

_STEPS_KEPT = 300


@dataclass(frozen=True)
class Curve:
    """One curve.

    Attributes:
        subset: of the labelled objects.
        view: which overlap was asked for.
        iou: smallest overlap of a match.
        recall: (K,) never falls; empty when there is nothing to score.
        precision: (K,).
        average_precision: the pooled one that `evaluate` prints; None without labels and objects.
        predictions: labels scored.
        truths: labelled objects scored.
    """

    subset: Subset
    view: View
    iou: float
    recall: FloatArray
    precision: FloatArray
    average_precision: float | None
    predictions: int
    truths: int


def precision_recall_curves(
    tallied: Tallied, settings: Settings, ious: tuple[float, ...]
) -> list[Curve]:
    """Return a curve a subset, view and threshold, in the DontCare variant that is reported.

    Labels on objects outside a subset are left out of its curve, as its AP has it.

    Args:
        tallied: matched frames.
        settings: what they were matched with.
        ious: thresholds wanted; those that were not matched are left out.
    """
    reported = settings.variants[: len({view for view, _ in settings.variants})]
    curves = []
    for subset in SUBSETS:
        for view, regions in reported:
            members = [
                tally
                for (_, _, of_subset, of_view, with_regions), tally in tallied.tallies.items()
                if (of_subset, of_view, with_regions) == (subset, view, regions)
            ]
            total = merged(members, len(settings.ious))
            scores, hits, keep = total.columns()
            for level, iou in enumerate(settings.ious):
                if iou in ious:
                    kept = keep[level]
                    curves.append(
                        _curve(subset, view, iou, scores[kept], hits[level][kept], total.truths)
                    )
    return curves


def _curve(
    subset: Subset, view: View, iou: float, scores: FloatArray, hits: BoolArray, truths: int
) -> Curve:
    """One curve, thinned evenly to at most so many steps; its AP is that of all steps."""
    recall = precision = np.empty(0)
    if len(scores) and truths:
        recall, precision = precision_recall(scores, hits, truths)
    places = np.unique(np.linspace(0, max(len(recall) - 1, 0), _STEPS_KEPT).round().astype(int))
    shown = places[: len(recall)]
    return Curve(
        subset=subset,
        view=view,
        iou=iou,
        recall=recall[shown],
        precision=precision[shown],
        average_precision=average_precision(scores, hits, truths),
        predictions=len(scores),
        truths=truths,
    )
