"""The rule that lets paths into the library decides what its case file says."""

from __future__ import annotations

import tomllib
from typing import Any

import duckdb
import pytest
from rule_worlds import insert

from tcrdata.reports import run_report
from tcrdata.resources import resource_folder
from tcrdata.store import schemas

PATH = resource_folder("queries") / "cases" / "tracking" / "library_entries.toml"
CASES: list[dict[str, Any]] = tomllib.loads(PATH.read_text(encoding="utf-8"))["case"]
ROW = {
    "tracklet_id": "t", "selection_id": "x", "dataset": "d", "sequence": "s", "frame": 0,
    "round": 1, "frames": 9,
    "metric_scale": 1.0, "first_step_m": 0.1, "travel_m": 1.0, "passable": 1.0,
    "lowest_passable": 1.0, "visible_share": 1.0, "along_m": [], "down_m": [], "across_m": [],
    "turn_rad": [],
}  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=[case["name"] for case in CASES])
def test_the_rule_decides_as_its_case_says(case: dict[str, Any]) -> None:
    with duckdb.connect() as connection:
        connection.execute(schemas.ddl("trajectories"))
        insert(connection, "trajectories", [{**ROW, **row} for row in case["given"]])
        found = run_report(connection, "library_entries", case.get("set"), folder="tracking")
        assert [row[0] for row in found.fetchall()] == case["expected"]
