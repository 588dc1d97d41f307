"""Average precision as PASCAL VOC has it since 2010: the area under the precision envelope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.types import BoolArray, FloatArray


def average_precision(
    scores: NDArray[np.floating], hits: BoolArray, number_of_truths: int
) -> float | None:
    """Return the area under the envelope of precision over recall.

    Labels of equal score enter together, so that their order cannot change the result.

    Args:
        scores: (N,), larger is surer.
        hits: (N,) which labels found an object.
        number_of_truths: labelled objects.

    Returns:
        In [0, 1]: 0 when there is one of labels and objects but not the other; None when there is
        neither.
    """
    if not len(scores) or not number_of_truths:
        return 0.0 if len(scores) or number_of_truths else None
    recall, precision = precision_recall(scores, hits, number_of_truths)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))


def precision_recall(
    scores: NDArray[np.floating], hits: BoolArray, number_of_truths: int
) -> tuple[FloatArray, FloatArray]:
    """Return recall and precision, (K,) each, as ever less sure labels are taken in.

    One step a distinct score, from the surest down; recall never falls.

    Args:
        scores: (N,), larger is surer; N >= 1.
        hits: (N,) which labels found an object.
        number_of_truths: labelled objects, at least one.
    """
    order = np.argsort(-scores, kind="stable")
    ranked = scores[order]
    steps = np.flatnonzero(np.append(ranked[1:] != ranked[:-1], True))
    true_positives = np.cumsum(hits[order])[steps]
    return true_positives / number_of_truths, true_positives / (steps + 1)
