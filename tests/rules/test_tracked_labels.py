"""Boxes that tracking adds become labels: seen ones that match, unseen ones marked as gaps."""

from __future__ import annotations

import itertools
from typing import Any

from rule_worlds import GOOD_TRACK, proposal_rows, put, put_tracks

from tcrdata.rules import select
from tcrdata.store import Store, open_store
from tcrdata.store.followed import BOXES, stage_of

_names = itertools.count()


def followed(name: str, frame: int, score: float, **values: Any) -> tuple[dict[str, Any], ...]:
    row = {
        "proposal_id": name, "frame": frame, "source": "tracklet", "fit": "tracklet",
        "x_m": 9.0, "number_of_points": 40, "frames_from_observation": 0, **values,
    }  # fmt: skip
    word = {"proposal_id": name, "frame": frame, "source": "tracklet", "module": "tracklet",
            "confidence": score, "raw_value": score, "unit": "score"}  # fmt: skip
    return row, word


def world() -> Store:
    store = open_store(f"memory://tracked_labels{next(_names)}", create=True)
    put_tracks(store, "s", [{**GOOD_TRACK, "frame": 0, "source": "track", "fit": "track"}])
    rows, words = zip(
        followed("seen", 0, 0.8),
        followed("poor", 1, 0.2),
        followed("hidden", 2, 1.0, found="gap", number_of_points=0, frames_from_observation=2),
        followed("far_gap", 3, 1.0, found="gap", number_of_points=0, frames_from_observation=9),
        followed("on_the_track", 0, 0.9, x_m=0.0),
        strict=True,
    )
    chosen = select(store, "tcrdata").selection_id
    put(store, stage_of(BOXES, chosen), "s",
        {"proposals": proposal_rows(list(rows)), "confidences": list(words)})  # fmt: skip
    return store


def labels(store: Store, preset: str) -> dict[str, str]:
    chosen = select(store, preset)
    rows = store.read("labels", selection_id=chosen.selection_id).to_pylist()
    return {row["proposal_id"]: row["source"] for row in rows if row["state"] == "positive"}


def test_tracklets_add_boxes_where_no_track_has_one() -> None:
    store = world()
    found = labels(store, "tcrdata_tracked")
    assert {name for name, source in found.items() if source == "tracklet"} == {"seen", "hidden"}
    assert "d/s/000000" in found


def test_other_presets_take_none() -> None:
    assert set(labels(world(), "tcrdata").values()) == {"track"}
