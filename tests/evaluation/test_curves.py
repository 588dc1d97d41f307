"""Curves: what a hand count gives, and the same AP that the scores have."""

from __future__ import annotations

import numpy as np
from label_worlds import box, frame_row, label_row, make_store, sequence_row, truth_row

from tcrdata.evaluation.ap import precision_recall
from tcrdata.evaluation.curves import precision_recall_curves
from tcrdata.evaluation.protocol import Settings
from tcrdata.evaluation.scoring import scored, tally_selection


def test_labels_of_equal_score_enter_together() -> None:
    recall, precision = precision_recall(
        np.array([0.9, 0.5, 0.5, 0.1]), np.array([True, False, True, True]), 4
    )
    np.testing.assert_allclose(recall, [0.25, 0.5, 0.75])
    np.testing.assert_allclose(precision, [1, 2 / 3, 3 / 4])


def test_curves_have_the_ap_of_the_scores() -> None:
    store = make_store(
        "curves",
        sequences=[sequence_row("one")],
        frames=[frame_row("one", 0)],
        ground_truth=[
            truth_row("one", 0, "a", **box(0, 10)),
            truth_row("one", 0, "b", **box(5, 20)),
        ],
        labels=[
            label_row("one", 0, "p", 0.9, **box(0, 10)),
            label_row("one", 0, "q", 0.5, **box(-5, 20)),
        ],
    )
    settings = Settings()
    tallied = tally_selection(store, "s1", settings)
    evaluation = scored(tallied, settings)
    curves = precision_recall_curves(tallied, settings, (0.5,))
    assert {(c.subset, c.view) for c in curves} == {
        (subset, view) for subset in ("all", "moving") for view in ("bev", "2d")
    }
    for curve in curves:
        score = evaluation.find(curve.subset, curve.view, "ap_pooled")[0.5]
        assert (curve.average_precision, curve.truths) == (score.value, score.truths)
    (bev,) = (c for c in curves if (c.subset, c.view) == ("all", "bev"))
    assert (bev.recall.tolist(), bev.precision.tolist()) == ([0.5, 0.5], [1.0, 0.5])
