"""Boxes that tracking adds become labels: seen ones that match, unseen ones marked as gaps."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from rule_worlds import GOOD_TRACK, proposal_rows, put, put_tracks

from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.rules import select
from tcrdata.store import Store, open_store
from tcrdata.store.followed import BOXES, check_followed, stage_of

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


def table_world() -> Store:
    """A thing on a table, and boxes that tracking adds on it, beside it, and out of sight."""
    store = open_store(f"memory://tracked_labels{next(_names)}", create=True)
    thing = {"frame": 0, "source": "table", "fit": "min_area", "age_frames": 9,
             "track_fill_share": 0.95, "number_of_points": 90, "proposal_id": "thing"}  # fmt: skip
    put(store, "table_clusters", "s", {"proposals": proposal_rows([thing])})
    rows, words = zip(
        followed("seen", 1, 0.8),
        followed("on_the_thing", 0, 0.9, x_m=0.0),
        followed("poor", 2, 0.2),
        followed("hidden", 3, 1.0, found="gap", number_of_points=0),
        followed("perhaps", 4, 0.9, found="gap", number_of_points=0),
        strict=True,
    )
    chosen = select(store, "tabletop").selection_id
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


def test_a_table_takes_what_still_matches_and_leaves_ways_out_of_sight_undecided() -> None:
    store = table_world()
    chosen = select(store, "tabletop_tracked")
    rows = store.read("labels", selection_id=chosen.selection_id).to_pylist()
    assert {row["proposal_id"]: row["state"] for row in rows} == {
        "thing": "positive", "seen": "positive", "hidden": "ignore",
    }  # fmt: skip
    assert chosen.followed == select(store, "tabletop").selection_id


def test_boxes_are_taken_from_the_selection_that_is_named() -> None:
    store = world()
    first = select(store, "tcrdata")
    other = select(store, "tcrdata", {"min_travel_m": 4}, name="other")
    rows, words = zip(followed("others", 5, 0.9), strict=True)
    put(store, stage_of(BOXES, other.selection_id), "s",
        {"proposals": proposal_rows(list(rows)), "confidences": list(words)})  # fmt: skip
    assert select(store, "tcrdata_tracked").followed == other.selection_id
    named = select(store, "tcrdata_tracked", followed=first.selection_id)
    check_followed(store, first.selection_id, "tcrdata", 1)
    found = store.read("labels", selection_id=named.selection_id).to_pylist()
    assert {"seen", "hidden"} <= {row["proposal_id"] for row in found}
    assert "others" not in {row["proposal_id"] for row in found}


def test_whose_boxes_cannot_be_taken_is_said() -> None:
    store = world()
    untracked = select(store, "tcrdata", {"min_travel_m": 4}, name="other").selection_id
    with pytest.raises(MissingEvidenceError, match="not tracked: run tcrdata track --store memory"):
        check_followed(store, untracked, "tcrdata", 1)
    with pytest.raises(SettingsError, match="'other' is of preset tcrdata and round 1: name one"):
        check_followed(store, untracked, "tcrdata_learned", 2)
