"""`tcrdata.open`: queries, frames, and the view `checks`."""

from __future__ import annotations

import subprocess
import sys

import pytest

import tcrdata
from tcrdata.errors import QueryError, SchemaError, StoreError
from tcrdata.store import Unit, open_store

RULE = "select proposal_id, number_of_points::double as value, {bound}::double as bound, "
RULE += "number_of_points >= {bound} as passed from proposals p"


def propose(store, points, settings="s"):
    rows = {name: [0.0] * len(points) for name in ("x_m", "y_m", "z_m", "length_m", "width_m")}
    rows |= {name: [1.0] * len(points) for name in ("height_m", "yaw_rad", "range_m")}
    rows |= {name: ["a"] * len(points) for name in ("source", "fit", "region_id", "found")}
    rows |= {"frame": [0] * len(points), "metric_scale": [1.0] * len(points)}
    rows |= {"proposal_id": [f"p{n}" for n in range(len(points))], "number_of_points": points}
    unit = Unit("regions", "demo", "0000", 1)
    with store.writer(unit, settings_hash=settings, inputs={}) as writer:
        writer.append("proposals", rows)


def select(store, selection_id, bound):
    snapshot = store.freeze(tables=None).name
    row = {
        "selection_id": selection_id,
        "name": f"at least {bound}",
        "preset": "tcrdata",
        "snapshot": snapshot,
        "rules": ["points"],
        "rule_texts": [RULE.format(bound=bound)],
        "required": [True],
        "preset_text": "",
        "parameters": {"least": str(bound)},
        "proposals_judged": 2,
        "labels": 1,
    }
    unit = Unit("selection", "_", selection_id, 1)
    with store.writer(unit, settings_hash="s", inputs={}) as writer:
        writer.append("selections", {name: [value] for name, value in row.items()})


@pytest.fixture
def store(tmp_path):
    return open_store(str(tmp_path / "store"), create=True)


def test_queries_take_parameters(store):
    propose(store, [3, 30])
    opened = tcrdata.open(store.url)
    query = "select proposal_id from proposals where number_of_points > $least"
    assert opened.sql(query, least=10).fetchall() == [("p1",)]
    assert opened.sql("from labels").fetchall() == []
    assert opened.table("proposals").collect()["number_of_points"].to_list() == [3, 30]


def test_without_a_selection_there_are_no_checks(store):
    assert tcrdata.open(store.url).table("checks").collect().height == 0


def test_each_selection_is_checked_over_the_files_it_read(store):
    propose(store, [3, 30])
    select(store, "first", 10)
    select(store, "second", 20)
    propose(store, [100, 100, 100], settings="t")
    opened = tcrdata.open(store.url)
    query = "select selection_id, proposal_id, value, bound, passed from checks order by all"
    assert opened.sql(query).fetchall() == [
        ("first", "p0", 3.0, 10.0, False),
        ("first", "p1", 30.0, 10.0, True),
        ("second", "p0", 3.0, 20.0, False),
        ("second", "p1", 30.0, 20.0, True),
    ]
    assert opened.table("checks").collect().height == 4
    assert opened.sql("select count(*) from proposals").fetchall() == [(3,)]


def test_what_does_not_run_is_one_line(store):
    opened = tcrdata.open(store.url)
    with pytest.raises(QueryError, match="propsals") as error:
        opened.sql("select *\nfrom propsals")
    assert "\n" not in str(error.value)
    with pytest.raises(QueryError, match=r'near "propsals" \(line 2 of the query\); mend it'):
        opened.sql("select *\nform propsals")
    with pytest.raises(SchemaError, match="no table 'propsals'"):
        opened.table("propsals")
    with pytest.raises(StoreError, match="there is no store"):
        tcrdata.open(store.url + "/none")


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, tcrdata; print([m for m in sys.modules if m in ('duckdb', 'pyarrow')])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]"
