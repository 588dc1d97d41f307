"""The view `verdicts` says in one row a proposal what `checks` says in one a rule."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from rule_worlds import GOOD_TRACK, put_tracks

import tcrdata
from tcrdata.rules import load_preset, select
from tcrdata.rules.verdicts import columns_read
from tcrdata.store import Store

Write = Callable[[str, str], Path]
DIFFERENCES = """
    select count(*), count(*) filter (
        (c.value, c.bound, c.passed) is distinct from
        (v.value[list_position(rules, rule)], v.bound[list_position(rules, rule)],
         v.passed[list_position(rules, rule)]))
    from checks c left join verdicts v using (selection_id, selection, proposal_id)
"""
TRACKS = [
    GOOD_TRACK,
    {**GOOD_TRACK, "travel_m": 0.5, "frame": 1},
    {**GOOD_TRACK, "straightness": 0.1, "number_of_points": 5},
    {**GOOD_TRACK, "source": "free_space", "fit": "l_shape", "frame": 7},
]


def own_preset(write_sql: Write, select_text: str, required: str = "") -> str:
    head = "-- Mine.\n-- source: me\n-- needs: true\n-- cues:\n"
    write_sql("rules/mine.sql", head + select_text)
    return str(
        write_sql(
            "my.sql",
            f"-- Mine.\n-- rules: mine\n-- required: {required}\n-- cues: tracks\n"
            "select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p\n",
        )
    )


def test_it_says_what_checks_say(store: Store) -> None:
    put_tracks(store, "a", TRACKS)
    put_tracks(store, "b", TRACKS[::-1])
    select(store, "tcrdata")
    select(store, "tcrdata", {"min_points": 4}, name="few")
    opened = tcrdata.open(store.url)
    rules = len(load_preset("tcrdata").rules)
    assert opened.sql(DIFFERENCES).fetchall() == [(2 * 8 * rules, 0)]
    assert opened.sql("select count(*) from verdicts where selection = 'few'").fetchall() == [(8,)]
    assert opened.table("verdicts").collect().height == 16


@pytest.mark.parametrize(
    "text",
    [
        "select proposal_id, 1::double as value, 2::double as bound, true as passed from proposals",
        "select p.proposal_id, c.confidence as value, 0.5::double as bound, value > bound as passed"
        "\nfrom proposals p left join confidences c using (proposal_id)",
        "with q as (from proposals) select q.proposal_id, q.range_m as value, 2::double as bound,"
        " value >= bound as passed from q",
        "select p.proposal_id, max(e.cycle_error_m) as value, 2::double as bound,"
        " max(e.cycle_error_m) < 2 as passed from proposals p left join egomotions e"
        " on e.sequence = p.sequence group by p.proposal_id",
    ],
)
def test_a_rule_of_any_form_is_judged(store: Store, write_sql: Write, text: str) -> None:
    put_tracks(store, "a", TRACKS)
    select(store, own_preset(write_sql, text))
    assert tcrdata.open(store.url).sql(DIFFERENCES).fetchall() == [(4, 0)]


def test_masks_and_margins(store: Store, write_sql: Write) -> None:
    put_tracks(store, "a", [{**GOOD_TRACK, "range_m": r} for r in (3.0, 12.0)])
    text = (
        "select p.proposal_id, p.range_m as value, 4::double as bound, "
        "if(p.range_m > 10, null, value >= bound) as passed from proposals p"
    )
    made = select(store, own_preset(write_sql, text, required="mine"))
    rows = tcrdata.open(store.url).sql(
        "select rules, margin, failed, abstained, blocked from verdicts order by proposal_id"
    )
    assert made.labels == 0
    assert rows.fetchall() == [(["mine"], [-0.25], 1, 0, 1), (["mine"], [None], 0, 1, 1)]


def test_an_infinite_bound_has_no_margin_and_a_bound_of_zero_counts_in_units(
    store: Store, write_sql: Write
) -> None:
    put_tracks(store, "a", [{**GOOD_TRACK, "range_m": 3.0}, {**GOOD_TRACK, "range_m": 12.0}])
    text = (
        "select p.proposal_id, p.range_m as value, "
        "if(p.range_m > 10, 'infinity'::double, 0.0) as bound, value >= bound as passed "
        "from proposals p"
    )
    select(store, own_preset(write_sql, text))
    found = tcrdata.open(store.url).sql("select margin, failed from verdicts order by proposal_id")
    assert found.fetchall() == [([3.0], 0), ([None], 1)]


def test_only_the_columns_that_rules_read_are_carried(store: Store, write_sql: Write) -> None:
    put_tracks(store, "a", [GOOD_TRACK])
    text = (
        "select p.proposal_id, p.range_m as value, 4::double as bound, true as passed "
        "from proposals p"
    )
    select(store, own_preset(write_sql, text))
    assert columns_read(store.read("selections").to_pylist()) == [
        "dataset", "frame", "proposal_id", "range_m", "round", "sequence", "source",
    ]  # fmt: skip
