"""Scores of tracking by hand: overlap over time, ends, returns, and TrackEval's on our arrays."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from label_worlds import box, columns_of, frame_row, label_row, make_store, sequence_row, truth_row

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.tracking_metrics import evaluate_tracking
from tcrdata.evaluation.tracking_rows import store_tracking_metrics
from tcrdata.evaluation.tracking_scores import TrackingSettings
from tcrdata.store import Store, Unit

_names = itertools.count()
FRAMES = 10
COMMON = {
    "selection_id": "s1",
    "library": False,
    "tracker": "auto",
    "found": "nearest",
    "visible_share": 1.0,
    "score": 1.0,
    "number_of_points": 9,
    "passable": 1.0,
    "frames_from_sighting": 0,
}


def world(tracklets: list[dict[str, Any]], started: list[dict[str, Any]], **more: Any) -> Store:
    """Two cars, one driving by at z = 15 m, one parked at z = 20 m, in ten frames."""
    truth = [
        truth_row("a", f, "mover", **box(-4.0 + 0.8 * f, 15.0), speed_mps=8.0)
        for f in range(FRAMES)
    ]
    truth += [truth_row("a", f, "parked", **box(3.0, 20.0)) for f in range(FRAMES)]
    labels = [
        label_row("a", f, f"m{f}", 0.9, **box(-4.0 + 0.8 * f, 15.0), track_id="t")
        for f in range(FRAMES)
    ]
    store = make_store(
        f"tracking_metrics{next(_names)}",
        sequences=[sequence_row("a")],
        frames=[frame_row("a", f) for f in range(FRAMES)],
        ground_truth=more.get("truth", truth),
        labels=labels,
    )
    with store.writer(Unit("tracklets", "kitti", "a", 1), settings_hash="0", inputs={}) as writer:
        writer.append("tracklets", columns_of([{**COMMON, **row} for row in tracklets]))
        writer.append("truth_tracklets", columns_of([{**COMMON, **row} for row in started]))
    return store


def rows(name: str, places: dict[int, dict[str, float]], **more: Any) -> list[dict[str, Any]]:
    names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
    return [
        {"tracklet_id": name, "frame": f, **{n: place[n] for n in names}, **more}
        for f, place in places.items()
    ]


def driving(frames: range, off: float = 0.0) -> dict[int, dict[str, float]]:
    return {f: box(-4.0 + 0.8 * f + off, 15.0) for f in frames}


def test_overlap_over_time_and_who_moved() -> None:
    started = rows("s0", driving(range(5)), object_id="mover")
    started += rows("s1", {f: box(3.0 + 0.4 * (f > 0), 20.0) for f in range(10)},
                    object_id="parked")  # fmt: skip
    result = evaluate_tracking(world([], started), "s1")
    curves = {(c.kind, c.subset): c for c in result.curves}
    both = curves["truth_tracklet", "all"]
    shifted = 3.6 / 4.4  # 4 m long, 0.4 m off
    assert both.iou[0] == pytest.approx(1.0)
    assert both.iou[4] == pytest.approx((1.0 + shifted) / 2)
    assert both.iou[9] == pytest.approx((0.0 + shifted) / 2), "what has ended scores 0"
    assert both.iou[10] is None
    assert both.objects[:11] == (2,) * 10 + (0,)
    assert curves["truth_tracklet", "moved"].iou[9] == pytest.approx(0.0)


def test_first_to_last() -> None:
    """One holds its car, one goes over to the other car, one begins on nothing."""
    tracklets = rows("whole", {f: box(3.0, 20.0) for f in range(10)})
    tracklets += rows("stolen", driving(range(5)) | {f: box(3.0, 20.0) for f in range(5, 10)})
    tracklets += rows("nowhere", {f: box(-9.0, 25.0) for f in range(3)})
    (ends,) = evaluate_tracking(world(tracklets, []), "s1").ends
    assert (ends.kind, ends.objects, ends.tracklets) == ("tracklet", 2, 2)
    assert (ends.recall, ends.recall_throughout, ends.precision) == (0.5, 0.5, 0.5)


def test_scores_are_stored_once_beside_those_of_labels() -> None:
    store = world(rows("whole", {f: box(3.0, 20.0) for f in range(10)}), [])
    settings = TrackingSettings()
    for _ in range(2):
        store_tracking_metrics(store, "s1", evaluate_tracking(store, "s1"), settings, 1)
    stored = {
        (row["metric"], row["iou"]): (row["value"], row["predictions"], row["truths"])
        for row in store.read("metrics", selection_id="s1").to_pylist()
    }
    assert len(stored) == store.read("metrics").num_rows
    assert stored["tracklet.recall_first_to_last", 0.5] == (0.5, 1, 2)
    assert stored["tracklet.precision_first_to_last", 0.5] == (1.0, 1, 2)
    # One of two cars is found, and never lost.
    assert stored["tracklet.det_a", 0.0][0] == pytest.approx(0.5)
    assert stored["tracklet.hota", 0.0][0] == pytest.approx(0.5**0.5)
    assert stored["tracklet.switches", 0.5][0] == 0.0


def test_return_after_being_hidden_behind_and_inside() -> None:
    truth = []
    for f in range(FRAMES):
        seen = 100 if f < 3 or f > 5 else 0
        truth.append(truth_row("a", f, "behind", **box(0.0, 15.0), visible_px=seen))
        truth.append(truth_row("a", f, "inside", **box(5.0, 15.0, size=0.5), visible_px=seen,
                               contained_in="cover" if seen == 0 else None))  # fmt: skip
        truth.append(truth_row("a", f, "cover", **box(5.0, 15.0), visible_px=900))
    started = rows("s0", {f: box(0.0, 15.0) for f in range(10)}, object_id="behind")
    started += rows("s1", {f: box(5.0, 15.0, size=0.5) for f in range(4)}, object_id="inside")
    result = evaluate_tracking(world([], started, truth=truth), "s1")
    assert {(r.how, r.returns, r.recovered) for r in result.recoveries} == {
        ("behind", 1, 1),
        ("contained", 1, 0),
    }


def test_identity_scores_of_a_perfect_and_of_a_broken_track() -> None:
    pytest.importorskip("trackeval")
    tracklets = rows("one", driving(range(5))) + rows("two", driving(range(5, 10)))
    tracklets += rows("parked", {f: box(3.0, 20.0) for f in range(10)})
    scores = {i.kind: i for i in evaluate_tracking(world(tracklets, []), "s1").identity}
    broken, labels = scores["tracklet"], scores["label"]
    assert (broken.switches, broken.truths, broken.boxes) == (1, 20, 20)
    assert broken.detection == pytest.approx(1.0)
    assert broken.mota == pytest.approx(1 - 1 / 20)
    assert broken.association == pytest.approx((10 * 0.5 + 10 * 1.0) / 20)
    assert (labels.switches, labels.boxes) == (0, 10)
    assert labels.association == pytest.approx(1.0)
    assert labels.mota == pytest.approx(0.5)


def test_nothing_tracked_is_said() -> None:
    with pytest.raises(MissingEvidenceError, match="was tracked yet: run `tcrdata track "):
        evaluate_tracking(world([], []), "s1")
    with pytest.raises(MissingEvidenceError, match="there is no selection 'none'"):
        evaluate_tracking(world([], []), "none")


def test_without_trackeval_the_other_scores_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "trackeval", None)
    tracklets = rows("whole", {f: box(3.0, 20.0) for f in range(10)})
    result = evaluate_tracking(world(tracklets, []), "s1")
    assert result.ends[0].recall == 0.5
    assert result.identity == ()
    assert result.without_identity is not None
    assert "pip install 'tcrdata[eval]'" in result.without_identity
