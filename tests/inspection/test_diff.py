"""Two selections compared: what came, went and moved, and by whose doing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli_runs import done, refused
from rule_worlds import GOOD_TRACK, proposal_rows, put, put_tracks

from tcrdata.errors import SettingsError
from tcrdata.inspection.diff import Difference, diff
from tcrdata.rules import select
from tcrdata.store import Store, open_store

RULE = (
    "-- Mine.\n-- source: me\n-- needs: value {sign} bound\n-- cues:\n"
    "set variable least_range_m = {bound};  -- m: from the sensor\n"
    "select p.proposal_id, p.range_m as value, getvariable('least_range_m')::double as bound,\n"
    "       value {sign} bound as passed\nfrom proposals p\n"
)
PRESET = (
    "-- Mine.\n-- rules: mine\n-- required:\n-- cues: tracks\n"
    "select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p\n{where}\n"
)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    store = open_store(str(tmp_path / "store"), create=True)
    ranges = (3.0, 5.0, 7.0, 9.0)
    put_tracks(
        store, "a", [{**GOOD_TRACK, "range_m": r, "z_m": 10 * r, "frame": 3} for r in ranges]
    )
    return store


def own(folder: Path, bound: float = 4, sign: str = ">=", where: str = "") -> str:
    (folder / "rules").mkdir(parents=True, exist_ok=True)
    (folder / "rules" / "mine.sql").write_text(RULE.format(bound=bound, sign=sign))
    (folder / "my.sql").write_text(PRESET.format(where=where))
    return str(folder / "my.sql")


def counts(found: Difference) -> dict[str, int]:
    return {row["change"]: row["labels"] for row in found.changes}


def causes(found: Difference) -> list[tuple[Any, ...]]:
    return [(row["change"], row["labels"], row["rules"], row["because"]) for row in found.causes]


def test_a_parameter_is_named_with_both_values(store: Store, tmp_path: Path) -> None:
    a = select(store, own(tmp_path), name="a").selection_id
    b = select(store, own(tmp_path), {"least_range_m": 8}, name="b").selection_id
    found = diff(store, a, b)
    assert counts(found) == {"kept": 1, "lost": 2}
    assert causes(found) == [("lost", 2, ["mine"], ["least_range_m 4 -> 8"])]
    assert found.causes[0]["examples"] == ["d/a/000001", "d/a/000002"]
    assert [(row["sequence"], row["change"], row["labels"]) for row in found.sequences] == [
        ("a", "kept", 1),
        ("a", "lost", 2),
    ]
    back = diff(store, b, a)
    assert causes(back) == [("gained", 2, ["mine"], ["least_range_m 8 -> 4"])]


def test_an_edited_rule_shows_as_its_text_changed(store: Store, tmp_path: Path) -> None:
    a = select(store, own(tmp_path, bound=5), name="a").selection_id
    b = select(store, own(tmp_path, bound=5, sign=">"), name="b").selection_id
    found = diff(store, a, b)
    assert causes(found) == [("lost", 1, ["mine"], ["rule text changed"])]
    (rule,) = found.to_json()["rules"]
    assert (rule["rule"], rule["change"], rule["parameters"]) == ("mine", "text", [])
    assert rule["text_a"] != rule["text_b"]


def test_a_number_edited_in_the_text_is_no_parameter(store: Store, tmp_path: Path) -> None:
    path = own(tmp_path)
    rule = tmp_path / "rules" / "mine.sql"
    rule.write_text(rule.read_text().replace("value >= bound", "value + (0) >= bound"))
    a = select(store, path, name="a").selection_id
    rule.write_text(rule.read_text().replace("value + (0)", "value + (1)"))
    found = diff(store, a, select(store, path, name="b").selection_id)
    assert causes(found) == [("gained", 1, ["mine"], ["rule text changed"])]


def test_the_presets_own_select_is_named(store: Store, tmp_path: Path) -> None:
    a = select(store, own(tmp_path), name="a").selection_id
    b = select(store, own(tmp_path, where="where p.range_m < 6"), name="b").selection_id
    assert causes(diff(store, a, b)) == [("lost", 2, [], ["rule text changed"])]


def test_rules_of_one_selection_alone_are_named(store: Store, tmp_path: Path) -> None:
    a = select(store, own(tmp_path, bound=0), name="a").selection_id
    found = diff(store, a, select(store, "tcrdata").selection_id)
    changes = {row["rule"]: row["change"] for row in found.rules}
    assert (changes["mine"], changes["range"]) == ("only in A", "only in B")
    assert ("to_ignore", 1, ["range"], ["rule only in B"]) in causes(found) or (
        "lost", 1, ["range"], ["rule only in B"]
    ) in causes(found)  # fmt: skip


def test_other_evidence_under_the_same_rules(store: Store, tmp_path: Path) -> None:
    a = select(store, own(tmp_path), name="a").selection_id
    ranges = (3.0, 2.0, 7.0, 9.0, 9.5)
    rows = [{**GOOD_TRACK, "range_m": r, "z_m": 10 * r, "frame": 3} for r in ranges]
    rows[2]["x_m"] = 1.0
    rows[3]["yaw_rad"] = 0.25
    named = [{"proposal_id": f"d/a/{number:06d}", **row} for number, row in enumerate(rows)]
    put(store, "tracks", "a", {"proposals": proposal_rows(named)}, settings_hash="again")
    found = diff(store, a, select(store, own(tmp_path), name="b").selection_id)
    assert counts(found) == {"gained": 1, "lost": 1, "moved": 2}
    assert causes(found) == [
        ("gained", 1, None, ["measured only in B"]),
        ("lost", 1, ["mine"], ["other evidence under the same rule"]),
    ]
    (moved,) = [row for row in found.changes if row["change"] == "moved"]
    assert moved["centre_m"] == pytest.approx([0.5, 0.9])
    assert moved["turn_rad"] == pytest.approx([0.125, 0.225])
    assert moved["size_m"] == [0.0, 0.0]


def test_another_proposal_near_by_is_the_same_object(store: Store, tmp_path: Path) -> None:
    near = {**GOOD_TRACK, "frame": 3, "range_m": 20.0, "source": "static"}
    put_tracks(store, "b", [{**near, "source": "track"}, {**near, "x_m": 1.0}, {**near, "x_m": 9}])
    a = select(store, own(tmp_path, where="where p.source = 'track'"), name="a").selection_id
    b = select(store, own(tmp_path, where="where p.source = 'static'"), name="b").selection_id
    found = diff(store, a, b)
    assert counts(found) == {"gained": 1, "lost": 3, "moved": 1}
    (moved,) = [row for row in found.changes if row["change"] == "moved"]
    assert moved["centre_m"] == [1.0, 1.0]


def test_the_command_prints_tables_or_json(store: Store, tmp_path: Path) -> None:
    select(store, own(tmp_path), name="a")
    select(store, own(tmp_path), {"least_range_m": 8}, name="b")
    printed = done("diff", "a", "b", "--store", store.url)
    assert "least_range_m" in printed.out
    assert f"next: tcrdata why d/a/000001 --store {store.url} --selection b" in printed.err
    found = done("diff", "a", "b", "--store", store.url, "--json").json
    assert list(found) == ["a", "b", "rules", "changes", "causes", "sequences"]
    assert found["causes"][0]["because"] == ["least_range_m 4 -> 8"]
    later = select(store, own(tmp_path), {"least_range_m": 9}, name="c", round=2)
    said = done("diff", "b", "2", "--store", store.url).err
    assert said.strip().endswith(f"--selection {later.selection_id}")


def test_what_cannot_be_compared_is_refused(store: Store, tmp_path: Path) -> None:
    def said(*names: str) -> str:
        return refused("diff", *names, "--store", store.url)

    assert "no selection 'a'; there are: none" in said("a", "b")
    a = select(store, own(tmp_path), name="a").selection_id
    with pytest.raises(SettingsError, match="same selection"):
        diff(store, a, a)
    assert "A and B are the same selection" in said("a", "1")
    assert "no selection '2'; there are: a" in said("a", "2")
    select(store, own(tmp_path), {"least_range_m": 8}, name="b")
    assert "round 1 has 2 selections: name one of a, b" in said("a", "1")
