"""Scores of small worlds that can be worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from label_worlds import (
    box,
    columns_of,
    frame_row,
    label_row,
    make_store,
    sequence_row,
    truth_row,
)

from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.evaluation.protocol import Settings
from tcrdata.evaluation.scoring import Evaluation, evaluate, store_metrics
from tcrdata.store import Unit

LEVEL = Settings(ious=(0.5,))
_names = iter(range(1000))


def world(
    truths: list[dict[str, Any]],
    labels: list[dict[str, Any]],
    sequences: list[dict[str, Any]] | None = None,
    frames: list[dict[str, Any]] | None = None,
) -> Any:
    return make_store(
        f"scoring{next(_names)}",
        sequences=sequences or [sequence_row("0000")],
        frames=frames or [frame_row("0000", number) for number in range(3)],
        ground_truth=truths,
        labels=labels,
    )


def value(evaluation: Evaluation, metric: str, view: str = "bev", subset: str = "all") -> Any:
    return evaluation.find(subset, view, metric)[0.5].value  # type: ignore[arg-type]


def test_truth_against_itself_scores_one() -> None:
    places = [(f, box(x, z, 0.3 * f)) for f in range(3) for x, z in ((-3.0, 10.0), (4.0, 20.0))]
    truths = [
        truth_row("0000", f, f"o{n}", speed_mps=5.0 * (n % 2), **b)
        for n, (f, b) in enumerate(places)
    ]
    labels = [label_row("0000", f, f"p{n}", 0.9, **b) for n, (f, b) in enumerate(places)]
    evaluation = evaluate(world(truths, labels), "s1")
    assert len(evaluation.scores) == 2 * 2 * 3 * 4 * 7  # scopes, subsets, variants, metrics, ious
    assert all(score.value == 1.0 for score in evaluation.scores)


def test_per_frame_and_pooled_by_hand() -> None:
    # Frame 0: a hit below a false one; frame 1: a miss; frame 2: nothing at all, left out.
    truths = [
        truth_row("0000", 0, "a", **box(0, 10)),
        truth_row("0000", 1, "a", **box(0, 10)),
    ]
    labels = [
        label_row("0000", 0, "hit", 0.5, **box(0, 10)),
        label_row("0000", 0, "wrong", 0.8, **box(5, 20)),
    ]
    evaluation = evaluate(world(truths, labels), "s1", LEVEL)
    assert value(evaluation, "ap_per_frame") == pytest.approx((0.5 + 0.0) / 2)
    assert value(evaluation, "ap_pooled") == pytest.approx(0.5 * 0.5)
    assert value(evaluation, "precision") == 0.5
    assert value(evaluation, "recall") == 0.5
    assert evaluation.frames == 3


def test_one_object_serves_one_label() -> None:
    truths = [truth_row("0000", 0, "a", **box(0, 10))]
    labels = [label_row("0000", 0, f"p{n}", 0.9 - n / 10, **box(0, 10)) for n in range(2)]
    evaluation = evaluate(world(truths, labels), "s1", LEVEL)
    assert value(evaluation, "precision") == 0.5
    assert value(evaluation, "ap_pooled") == 1.0


def test_moving_recall_is_on_moving_truth_and_precision_on_all() -> None:
    truths = [
        truth_row("0000", 0, "parked", speed_mps=0.2, **box(-3, 10)),
        truth_row("0000", 0, "moving", speed_mps=4.0, **box(3, 10)),
    ]
    labels = [label_row("0000", 0, "p", 0.9, **box(-3, 10))]
    evaluation = evaluate(world(truths, labels), "s1", replace(LEVEL, moving_only=True))
    assert value(evaluation, "precision", subset="moving") == 1.0
    assert value(evaluation, "recall", subset="moving") == 0.0
    assert {score.subset for score in evaluation.scores} == {"moving"}


def test_region_image_and_built_frames() -> None:
    truths = [
        truth_row("0000", 0, "far", **box(0, 40)),
        truth_row("0000", 0, "beside", **box(12, 10)),  # its centre is right of the image
        truth_row("0000", 1, "unread", **box(0, 10)),
        truth_row("0000", 7, "not built", **box(0, 10)),
        truth_row("0000", 2, "seen", **box(0, 10)),
    ]
    labels = [
        label_row("0000", 0, "far", 0.9, **box(0, 40)),
        label_row("0000", 2, "seen", 0.9, **box(0, 10)),
        {**label_row("0000", 2, "unsure", 0.9, **box(5, 10)), "state": "ignore"},
    ]
    frames = [frame_row("0000", 0), frame_row("0000", 1, "error"), frame_row("0000", 2)]
    score = evaluate(world(truths, labels, frames=frames), "s1", LEVEL).find(
        "all", "bev", "precision"
    )[0.5]
    assert (score.value, score.predictions, score.truths) == (1.0, 1, 1)


def test_label_on_an_object_across_the_border_is_left_out() -> None:
    truths = [
        truth_row("0000", 0, "outside", **box(0, 34.2)),
        truth_row("0000", 0, "inside", **box(0, 10)),
    ]
    labels = [label_row("0000", 0, "p", 0.9, **box(0, 33.9))]
    store = world(truths, labels)
    assert value(evaluate(store, "s1", LEVEL), "precision") is None
    strict = replace(LEVEL, leave_out_unscored=False)
    assert value(evaluate(store, "s1", strict), "precision") == 0.0
    wider = replace(LEVEL, parameters=(("max_depth_m", 50.0),))
    assert value(evaluate(store, "s1", wider), "precision") == 1.0


def test_dont_care_counts_in_the_image_alone() -> None:
    wrong = box(5, 20)
    region = {name: wrong[name] for name in ("left_px", "top_px", "right_px", "bottom_px")}
    truths = [
        truth_row("0000", 0, "a", **box(0, 10)),
        truth_row("0000", 0, "region", **region) | {"category": "DontCare", "speed_mps": None},
    ]
    labels = [
        label_row("0000", 0, "hit", 0.5, **box(0, 10)),
        label_row("0000", 0, "wrong", 0.8, **wrong),
    ]
    evaluation = evaluate(world(truths, labels), "s1", LEVEL)
    assert value(evaluation, "precision", "bev") == 0.5
    assert value(evaluation, "precision", "2d") == 1.0
    assert evaluation.find("all", "2d", "precision", dont_care=False)[0.5].value == 0.5
    both = evaluate(world(truths, labels), "s1", replace(LEVEL, dont_care_views=("bev", "2d")))
    assert value(both, "precision", "bev") == 1.0


def test_round_hidden_and_small_worlds() -> None:
    ball = box(0, 8, size=0.2) | {"length_m": 0.4, "width_m": 0.4}
    truths = [
        truth_row("0000", 0, "ball", visible_px=900, **ball) | {"yaw_observable": False},
        truth_row("0000", 0, "hidden", visible_px=3, **box(1, 9, size=0.2)),
    ]
    labels = [
        label_row("0000", 0, "p", 0.9, **(ball | {"yaw_rad": 0.78})),
        label_row("0000", 0, "q", 0.9, **box(1, 9, size=0.2)),
    ]
    store = world(truths, labels, sequences=[sequence_row("0000", "depth", 0.2)])
    evaluation = evaluate(store, "s1", Settings(ious=(0.5, 0.9)))
    score = evaluation.find("all", "bev", "precision")[0.9]
    assert (score.value, score.predictions, score.truths) == (1.0, 1, 1)


def test_a_tilted_object_has_the_hull_of_its_corners() -> None:
    # A cube of 2 m on its edge: from above 2 by 2.83 m; its upright box is what is drawn of it.
    s = 0.5**0.5
    tilted = box(0, 10) | {"length_m": 2 * 2**0.5, "width_m": 2.0, "height_m": 2 * 2**0.5}
    rotation = [s, -s, 0.0, s, s, 0.0, 0.0, 0.0, 1.0]
    truth = {"level_R_object": rotation, "object_size_m": [2.0, 2.0, 2.0]}
    store = world(
        [truth_row("0000", 0, "cube", **(tilted | truth))],
        [label_row("0000", 0, "p", 0.9, **tilted)],
    )
    evaluation = evaluate(store, "s1", Settings(ious=(0.99,)))
    assert evaluation.find("all", "bev", "precision")[0.99].value == 1.0


def test_sequences_without_truth_are_named_and_left_out() -> None:
    store = world(
        [truth_row("0000", 0, "a", **box(0, 10))],
        [label_row("0001", 0, "p", 0.9, **box(0, 10))],
        sequences=[sequence_row("0000"), sequence_row("0001")],
        frames=[frame_row("0000", 0), frame_row("0001", 0)],
    )
    evaluation = evaluate(store, "s1", replace(LEVEL, frames_a_pass=1))
    assert evaluation.without_truth == ("kitti/0001",)
    assert value(evaluation, "recall") == 0.0
    assert value(evaluation, "precision") is None


def test_missing_truth_and_speeds() -> None:
    with pytest.raises(MissingEvidenceError, match="no sequence of this store has labelled"):
        evaluate(world([], []), "s1")
    still = [truth_row("0000", 0, "a", **box(0, 10)) | {"speed_mps": None}]
    with pytest.raises(MissingEvidenceError, match="no labelled object has a known speed"):
        evaluate(world(still, []), "s1", Settings(moving_only=True))


def test_frames_built_after_the_selection_are_not_misses() -> None:
    truths = [truth_row("0000", f, "a", **box(0, 10)) for f in range(2)]
    labels = [label_row("0000", 0, "p", 0.9, **box(0, 10))]
    store = world(truths, labels, frames=[frame_row("0000", 0)])
    with store.writer(Unit("ingest", "kitti", "0000", 1), settings_hash="1", inputs={}) as writer:
        writer.append("sequences", columns_of([sequence_row("0000")]))
        writer.append("frames", columns_of([frame_row("0000", f) for f in range(2)]))
        writer.append("ground_truth", columns_of(truths))
    evaluation = evaluate(store, "s1", LEVEL)
    assert store.read("frames").num_rows == 2
    assert evaluation.frames == 1
    assert value(evaluation, "recall") == 1.0
    with pytest.raises(MissingEvidenceError, match="no selection 's9'"):
        evaluate(store, "s9")


def test_settings_that_make_no_sense() -> None:
    with pytest.raises(SettingsError, match="ious"):
        Settings(ious=(0.7, 0.5))
    store = world([truth_row("0000", 0, "a", **box(0, 10))], [])
    with pytest.raises(SettingsError, match="no parameter 'max_dept_m'"):
        evaluate(store, "s1", Settings(parameters=(("max_dept_m", 3),)))


def test_protocol_names_what_was_used() -> None:
    store = world([truth_row("0000", 0, "a", **box(0, 10))], [])
    settings = Settings(parameters=(("max_depth_m", 21.5), ("scored_sources", ["track"])))
    text = evaluate(store, "s1", settings).protocol
    assert "21.5" in text
    assert "[track]" in text
    assert "scores those 0" in text


def test_metrics_are_stored_once_and_equal() -> None:
    truths = [truth_row("0000", 0, "a", **box(0, 10))]
    store = world(truths, [label_row("0000", 0, "p", 0.9, **box(0, 10))])
    evaluation = evaluate(store, "s1", LEVEL)
    json.dumps(evaluation.to_json())
    store_metrics(store, evaluation, LEVEL, 1)
    store_metrics(store, evaluate(store, "s1", LEVEL), LEVEL, 1)
    rows = store.read("metrics").to_pylist()
    assert len(rows) == len(evaluation.scores)
    assert {row["value"] for row in rows if row["subset"] == "all"} == {1.0}
