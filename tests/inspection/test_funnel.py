"""The funnel of a selection on a world whose counts are known by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli_runs import done, refused
from rule_worlds import GOOD_TRACK, put, put_tracks

from tcrdata.inspection.funnel import funnel
from tcrdata.rules import load_preset, select
from tcrdata.store import Store, open_store

RULES = len(load_preset("tcrdata").rules)
TRACKS = [
    GOOD_TRACK,
    {**GOOD_TRACK, "range_m": 3.9},  # range alone, by 2.5 %
    {**GOOD_TRACK, "range_m": 1.0},  # range alone, by 75 %
    {**GOOD_TRACK, "range_m": 1.0, "overlapped_share": 0.9},  # two rules
    {**GOOD_TRACK, "overlapped_share": 0.9},
    {**GOOD_TRACK, "source": "free_space", "fit": "l_shape"},
]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    store = open_store(str(tmp_path / "store"), create=True)
    put_tracks(store, "a", TRACKS)
    return store


def by_rule(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {row["rule"]: row for row in rows}


def test_each_rule_counts_what_it_does(store: Store) -> None:
    found = funnel(store, select(store, "tcrdata").selection_id)
    rules = by_rule(found.rules)
    near = rules["range"]
    assert [near[name] for name in ("judged", "passed", "failed", "abstained")] == [6, 3, 3, 0]
    assert (near["alone"], near["near"]) == (2, 1)
    assert near["fails_too"]["not_overlapped"] == pytest.approx(1 / 3)
    assert near["margin_p50"] == pytest.approx((10 / 4 - 1 + 3.9 / 4 - 1) / 2)
    assert rules["not_overlapped"]["fails_too"]["range"] == 0.5
    assert (rules["source"]["failed"], rules["source"]["alone"]) == (1, 1)
    assert rules["source"]["margin_p50"] is None
    assert rules["travels"]["abstained"] == 1
    assert [rules[name]["left_over"] for name in ("source", "range", "not_overlapped")] == [5, 2, 1]
    assert found.rules[-1]["left_over"] == found.selection["labels"] == 1
    assert [row["place"] for row in found.rules] == list(range(1, RULES + 1))


def test_a_later_build_does_not_change_it(store: Store) -> None:
    made = select(store, "tcrdata")
    before = funnel(store, made.selection_id)
    put_tracks(store, "b", TRACKS)
    assert funnel(store, made.selection_id) == before


def test_modules_that_speak_of_the_same_are_paired(store: Store) -> None:
    said = [(0, 0.9, 0.8), (1, 0.9, 0.1), (2, 0.2, 0.7), (3, 0.1, None)]
    confidences = [
        {"proposal_id": f"d/a/{number:06d}", "frame": 0, "module": module, "confidence": value,
         "raw_value": value, "unit": "share"}
        for number, *values in said
        for module, value in zip(("here", "there"), values, strict=True)
    ]  # fmt: skip
    put(store, "modules", "a", {"confidences": confidences})
    rows = funnel(store, select(store, "tcrdata").selection_id).modules
    alone = {row["module"]: row for row in rows if row["other"] is None}
    assert [alone["there"][name] for name in ("asked", "both_speak", "both_sure")] == [4, 3, 2]
    (pair,) = [row for row in rows if (row["module"], row["other"]) == ("here", "there")]
    counts = ("both_speak", "both_sure", "only_module_sure", "only_other_sure", "none_sure")
    assert [pair[name] for name in counts] == [3, 1, 1, 1, 0]
    assert (pair["agreement"], pair["lift"]) == (pytest.approx(1 / 3), pytest.approx(3 / 4))


def test_selections_are_compared(store: Store) -> None:
    select(store, "tcrdata", {"min_range_m": 0.5, "max_overlapped_share": 1}, name="loose")
    found = funnel(store, select(store, "tcrdata").selection_id)
    (row,) = found.selections
    assert (row["other"], row["in_both"], row["only_selection"], row["only_other"]) == (
        "loose", 1, 0, 4,
    )  # fmt: skip
    assert row["shared"] == pytest.approx(1 / 5)


def test_the_command_prints_a_table_or_json(store: Store) -> None:
    select(store, "tcrdata")
    printed = done("funnel", "--store", store.url)
    assert "not_overlapped" in printed.out
    assert "rule range alone keeps out 2, 1 of them near its bound" in printed.err
    found = done("funnel", "--store", store.url, "--selection", "tcrdata", "--json").json
    assert (found["labels"], len(found["rules"])) == (1, RULES)
    assert list(found) == [
        "selection_id", "name", "preset", "round", "snapshot", "labels", "ignored", "rules",
        "modules", "selections",
    ]  # fmt: skip


def test_a_selection_without_proposals_has_empty_rules(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "empty"), create=True)
    put(store, "tracks", "a", {})
    put(store, "odometry", "a", {})
    found = funnel(store, select(store, "tcrdata").selection_id)
    assert {row["judged"] for row in found.rules} <= {0}
    done("funnel", "--store", store.url)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "the store has no selection yet: run tcrdata check"),
        (("--selection", "nope"), "no selection 'nope'; there are: none"),
    ],
)
def test_what_is_not_there_is_refused(
    store: Store, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused("funnel", "--store", store.url, *arguments)
