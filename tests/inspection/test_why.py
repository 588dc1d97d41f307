"""Why a proposal became what it is, on a small drive of which every verdict is known."""

from __future__ import annotations

import re
import uuid
from pathlib import Path
from typing import Any

import pytest
from rule_worlds import GOOD_TRACK, proposal_rows, put, put_tracks

from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.inspection.drives import Drives
from tcrdata.inspection.finding import find_by_id, find_by_place, parse_place
from tcrdata.inspection.why import Explanation, explain
from tcrdata.resources import resource_folder
from tcrdata.rules import select
from tcrdata.store import Store, open_store

TRACKS: list[dict[str, Any]] = [
    {"x_m": 0.0, "z_m": 10.0, "track_id": "a", "region_id": "a"},
    {"x_m": 8.0, "z_m": 10.0, "track_id": "b", "region_id": "b", "travel_m": 2.4, "age_frames": 5},
    {"x_m": 8.0, "z_m": 20.0, "track_id": "c", "travel_m": 0.5, "track_core_share": 0.1},
    {"x_m": -9.0, "z_m": 10.0, "track_id": "d", "age_frames": 2},
    {"x_m": 0.5, "z_m": 10.0, "source": "free_space", "fit": "l_shape", "region_id": "f"},
    {"x_m": 0.0, "z_m": 10.2, "frame": 1, "track_id": "a", "region_id": "a"},
    {"x_m": -9.0, "z_m": 30.0, "source": "static", "fit": "l_shape", "region_id": "g"},
]


@pytest.fixture
def store() -> Store:
    made = open_store(f"memory://why-{uuid.uuid4().hex}", create=True)
    for sequence in ("s1", "s2"):
        put_tracks(made, sequence, [{**GOOD_TRACK, **row} for row in TRACKS])
    return made


def row_of(store: Store, selection_id: str) -> dict[str, Any]:
    (row,) = store.read("selections", dataset="_", sequence=selection_id).to_pylist()
    return dict(row)


def why(store: Store, number: int, **overrides: object) -> Explanation:
    chosen = row_of(store, select(store, "tcrdata", overrides).selection_id)
    return explain(chosen, find_by_id(Drives(store), chosen, f"d/s1/{number:06d}"))


def stopping(found: Explanation) -> list[tuple[str, str | None]]:
    return [(rule.rule, rule.change) for rule in found.rules if rule.stops]


def test_a_label_passes_every_rule_and_names_the_tightest(store: Store) -> None:
    found = why(store, 0)
    assert found.outcome == "positive"
    assert stopping(found) == []
    (tightest,) = [rule for rule in found.rules if rule.tightest]
    assert (tightest.rule, tightest.margin) == ("core_share", pytest.approx((0.8 - 0.5) / 0.5))
    assert found.changes == ()


def test_the_rule_that_alone_decides_says_what_would_let_it_pass(store: Store) -> None:
    found = why(store, 1)
    (travels,) = [rule for rule in found.rules if rule.stops]
    assert (travels.rule, travels.alone, travels.verdict) == ("travels", True, "failed")
    assert (travels.value, travels.bound) == (2.4, 3.0)
    assert travels.margin == pytest.approx(-0.2)
    assert travels.says == "travels 2.4 m, needs >= 3 m"
    assert found.changes == ("min_travel_m=2.4",)


def test_the_changes_it_names_make_it_a_label(store: Store) -> None:
    for number in (1, 2, 3):
        found = why(store, number)
        assert found.outcome != "positive"
        overrides = dict(change.split("=") for change in found.changes)
        assert overrides
        assert why(store, number, **overrides).outcome == "positive"


def test_each_of_several_rules_has_its_change(store: Store) -> None:
    found = why(store, 2)
    assert [rule for rule, _ in stopping(found)] == ["travels", "core_share"]
    assert not any(rule.alone for rule in found.rules)
    assert found.changes[1] == "min_core_share=0.1"


def test_a_bound_out_of_reach_is_told_in_the_rules_words(store: Store) -> None:
    found = why(store, 3)
    (travels,) = [rule for rule in found.rules if rule.stops]
    assert travels.bound == float("inf")
    assert travels.says == "travels 5 m; too young or too crooked: never"
    assert travels.change == "min_age_frames=2"
    assert "Infinity" not in str(found.to_json()["changes"])


def test_what_the_preset_does_not_judge_is_stopped_by_source(store: Store) -> None:
    found = why(store, 4)
    source = found.rules[0]
    assert (source.rule, source.stops, source.value, source.margin) == ("source", True, None, None)
    assert source.says == "source failed, needs: source and fit are among those taken"
    assert found.changes == ()


def test_parameters_of_the_selection_are_told(store: Store) -> None:
    found = why(store, 1, min_travel_m=2.9)
    assert found.parameters == ("min_travel_m=2.9",)
    assert [rule.bound for rule in found.rules if rule.stops] == [2.9]


def test_its_track_and_its_place_in_this_selection(store: Store) -> None:
    found = why(store, 0)
    relations = {
        (row["relation"], row["source"], row["outcome"], row["proposal_id"])
        for row in found.relations
    }
    assert ("same track", "track", "positive", "d/s1/000005") in relations
    assert ("same place", "free_space", "rejected", "d/s1/000004") in relations
    assert len(relations) == 2


def test_other_selections_have_their_say(store: Store) -> None:
    select(store, "tcrdata", {"min_travel_m": 2}, name="nearer")
    found = why(store, 1)
    assert [(row["selection"], row["outcome"]) for row in found.others] == [("nearer", "positive")]


def test_evidence_is_told_with_its_unit(store: Store) -> None:
    found = why(store, 0)
    told = {(row["about"], row["name"]): (row["value"], row["unit"]) for row in found.evidence}
    assert told["module", "track"] == (0.75, "share")
    assert told["egomotion, odometry", "cycle_error"] == (0.05, "m")
    assert told["track", "travel"] == (5.0, "m")


def test_evidence_that_came_later_changes_no_answer(store: Store) -> None:
    chosen = row_of(store, select(store, "tcrdata").selection_id)
    moved = [{**GOOD_TRACK, **row, "travel_m": 0.0} for row in TRACKS]
    put_later(store, moved)
    found = explain(chosen, find_by_id(Drives(store), chosen, "d/s1/000000"))
    assert found.outcome == "positive"
    (travels,) = [rule for rule in found.rules if rule.rule == "travels"]
    assert travels.value == 5.0


def put_later(store: Store, rows: list[dict[str, Any]]) -> None:
    named = [{"proposal_id": f"d/s1/{number:06d}", **row} for number, row in enumerate(rows)]
    put(store, "tracks", "s1", {"proposals": proposal_rows(named)}, settings_hash="later")


@pytest.mark.parametrize(
    ("at", "taken", "distance"),
    [
        ("0,10", "d/s1/000000", 0.0),  # a track goes before the free-space box around the place
        ("3,10", "d/s1/000000", 1.0),
        ("8,12", "d/s1/000001", 1.0),
        ("-9,27", "d/s1/000006", 2.0),  # no judged one within reach: the nearest of all
    ],
)
def test_a_place_means_the_nearest_judged_proposal(
    store: Store, at: str, taken: str, distance: float
) -> None:
    chosen = row_of(store, select(store, "tcrdata").selection_id)
    found = find_by_place(Drives(store), chosen, "s1", 0, at)
    assert found.proposal_id == taken
    assert found.nearest[0]["distance_m"] == pytest.approx(distance)
    assert explain(chosen, found).proposal["proposal_id"] == taken


def test_a_drive_may_be_named_with_its_dataset(store: Store) -> None:
    chosen = row_of(store, select(store, "tcrdata").selection_id)
    assert find_by_place(Drives(store), chosen, "d/s2", 0, "0,10").proposal_id == "d/s2/000000"


@pytest.mark.parametrize(
    ("proposal", "message"),
    [
        ("track 3", "'track 3' is no proposal's id"),
        ("d/s3/000000", "judged no drive 'd/s3'; near: d/s"),
        ("d/s1/000009", "judged no proposal 'd/s1/000009'; near: d/s1/000000"),
    ],
)
def test_an_unknown_id_names_near_ones(store: Store, proposal: str, message: str) -> None:
    chosen = row_of(store, select(store, "tcrdata").selection_id)
    with pytest.raises(MissingEvidenceError, match=message):
        find_by_id(Drives(store), chosen, proposal)


def test_a_place_needs_a_drive_and_a_frame(store: Store) -> None:
    chosen = row_of(store, select(store, "tcrdata").selection_id)
    with pytest.raises(SettingsError, match="2 drives may be meant: name one with --sequence"):
        find_by_place(Drives(store), chosen, None, 0, "0,10")
    with pytest.raises(MissingEvidenceError, match=r"frame 7 of d/s1 has no proposal.* 0 to 1"):
        find_by_place(Drives(store), chosen, "s1", 7, "0,10")
    with pytest.raises(MissingEvidenceError, match="judged no drive 'x'"):
        find_by_place(Drives(store), chosen, "x", 0, "0,10")


@pytest.mark.parametrize("at", ["", "3", "3,", "a,b", "1,2,3", "nan,1", "inf,2"])
def test_what_is_no_place_is_refused(at: str) -> None:
    with pytest.raises(SettingsError, match="is no place: write X,Z in metres"):
        parse_place(at)


def test_what_the_presets_own_select_drops_is_left_out(store: Store, tmp_path: Path) -> None:
    """Every rule lets it pass, no label is made of it, and no change is named."""
    shipped = (resource_folder("queries") / "presets" / "tcrdata.sql").read_text()
    picky = re.sub(r"^-- (ignore|next|loosened):.*\n(--   .*\n)*", "", shipped, flags=re.MULTILINE)
    preset = tmp_path / "picky.sql"
    preset.write_text(picky.rstrip().rstrip(";") + "\nwhere p.frame > 0;\n")
    chosen = row_of(store, select(store, str(preset)).selection_id)
    found = explain(chosen, find_by_id(Drives(store), chosen, "d/s1/000000"), str(preset))
    assert found.outcome == "left out"
    assert stopping(found) == []
    assert found.changes == ()
    assert all(rule.source for rule in found.rules)


def test_a_place_is_two_numbers() -> None:
    assert parse_place("-2.5, 8") == (-2.5, 8.0)
