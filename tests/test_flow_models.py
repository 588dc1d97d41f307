"""Promotion: a finetuned flow network replaces its teacher only where stored numbers say so."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import duckdb
import pytest

from tcrdata.reports import run_report
from tcrdata.resources import resource_folder


@pytest.fixture
def shell() -> Iterator[duckdb.DuckDBPyConnection]:
    with duckdb.connect() as connection:
        for table in ("models", "flow_checks"):
            path = resource_folder("schemas") / f"{table}.sql"
            connection.execute(path.read_text(encoding="utf-8"))
        add_model(connection, "origin", None)
        yield connection


def insert(connection: duckdb.DuckDBPyConnection, table: str, row: dict[str, Any]) -> None:
    names = ", ".join(row)
    places = ", ".join("?" for _ in row)
    connection.execute(f"insert into {table} ({names}) values ({places})", list(row.values()))


def add_model(
    connection: duckdb.DuckDBPyConnection,
    name: str,
    teacher: str | None = None,
    finished: bool = True,
    start: str | None = None,
) -> None:
    before = {"teacher": teacher, "start": start}
    settings = {"network": {"size": "small"}} | {name: id for name, id in before.items() if id}
    insert(connection, "models", {
        "model_id": name, "kind": "flow", "network": "raft", "labels_round": 1,
        "selection_id": "", "snapshot": "", "query": "", "settings": json.dumps(settings),
        "seed": 0, "samples": 1, "positives": 0, "parameters": 1, "step": 1, "steps": 1,
        "finished": finished, "losses": [1.0], "terms": {},
    })  # fmt: skip


def add_check(
    connection: duckdb.DuckDBPyConnection,
    name: str,
    teacher: str,
    student: tuple[float, float | None],
    taught: tuple[float, float],
    pairs: int = 2,
) -> None:
    """Consistent share and photometric error of both, the same on each pair."""
    for role, measured, numbers in (("student", name, student), ("teacher", teacher, taught)):
        for frame in range(pairs):
            insert(connection, "flow_checks", {
                "model_id": name, "role": role, "measured_id": measured, "dataset": "kitti",
                "sequence": "a", "frame": frame, "frame_to": frame + 1, "pixels": 100,
                "consistent_share": numbers[0], "inside_share": 1.0,
                "photometric_error": numbers[1], "magnitude_median_px": 1.0,
            })  # fmt: skip


def states(connection: duckdb.DuckDBPyConnection, **parameters: Any) -> dict[str, tuple[str, bool]]:
    relation = run_report(connection, "flow_models", parameters)
    rows = [dict(zip(relation.columns, row, strict=True)) for row in relation.fetchall()]
    return {row["model_id"]: (row["state"], row["in_use"]) for row in rows}


@pytest.mark.parametrize(
    ("student", "state"),
    [
        ((0.71, 0.05), "promoted"),
        ((0.70, 0.04), "rejected"),
        ((0.71, 0.0501), "rejected"),
        ((0.60, 0.04), "rejected"),
        ((0.71, None), "rejected"),
    ],
)
def test_a_student_must_be_more_consistent_and_no_worse_on_the_images(
    shell: duckdb.DuckDBPyConnection, student: tuple[float, float | None], state: str
) -> None:
    add_model(shell, "student", "origin")
    add_check(shell, "student", "origin", student, (0.70, 0.05))
    assert states(shell) == {
        "origin": ("origin", state == "rejected"),
        "student": (state, state == "promoted"),
    }


def test_what_was_not_checked_on_enough_pairs_is_not_used(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_model(shell, "begun", "origin", finished=False)
    add_model(shell, "student", "origin")
    assert states(shell)["student"] == ("unchecked", False)
    assert states(shell)["begun"] == ("unchecked", False)
    add_check(shell, "student", "origin", (0.8, 0.04), (0.7, 0.05))
    assert states(shell)["student"] == ("promoted", True)
    assert states(shell, min_held_out_pairs=3)["student"] == ("rejected", False)
    assert states(shell, min_consistent_gain=0.2)["student"] == ("rejected", False)
    assert states(shell, max_photometric_ratio=0.5)["student"] == ("rejected", False)


def test_a_student_of_a_student_replaces_it(shell: duckdb.DuckDBPyConnection) -> None:
    add_model(shell, "second", "origin")
    add_check(shell, "second", "origin", (0.8, 0.04), (0.7, 0.05))
    add_model(shell, "third", "second")
    add_check(shell, "third", "second", (0.9, 0.03), (0.8, 0.04))
    used = {name for name, (_, in_use) in states(shell).items() if in_use}
    assert used == {"third"}


def in_use(connection: duckdb.DuckDBPyConnection) -> set[str]:
    return {name for name, (_, used) in states(connection).items() if used}


def test_who_comes_after_one_that_is_not_used_is_not_used_either(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_model(shell, "rejected", "origin")
    add_check(shell, "rejected", "origin", (0.5, 0.06), (0.7, 0.05))
    add_model(shell, "unchecked", "origin")
    for first in ("rejected", "unchecked"):
        add_model(shell, f"generated-{first}", start=first)
        for teacher in (first, f"generated-{first}"):
            add_model(shell, f"student-{teacher}", teacher)
            add_check(shell, f"student-{teacher}", teacher, (0.6, 0.05), (0.5, 0.06))
    assert in_use(shell) == {"origin"}


def test_one_that_went_on_from_generated_pairs_stands_in_for_its_start(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_model(shell, "begun", start="origin", finished=False)
    assert in_use(shell) == {"origin"}
    add_model(shell, "second", start="origin")
    assert in_use(shell) == {"second"}
    add_model(shell, "student", "second")
    add_check(shell, "student", "second", (0.8, 0.04), (0.7, 0.05))
    assert in_use(shell) == {"student"}
    add_model(shell, "third", start="student")
    assert in_use(shell) == {"third"}


def test_who_is_taught_by_a_rejected_one_is_not_used_either(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_model(shell, "rejected", "origin")
    add_check(shell, "rejected", "origin", (0.5, 0.06), (0.7, 0.05))
    for name, teacher, share in (("better", "rejected", 0.6), ("best", "better", 0.65)):
        add_model(shell, name, teacher)
        add_check(shell, name, teacher, (share, 0.05), (share - 0.1, 0.06))
    assert states(shell) == {
        "origin": ("origin", True),
        "rejected": ("rejected", False),
        "better": ("promoted", False),
        "best": ("promoted", False),
    }


@pytest.mark.parametrize(("share", "state"), [(0.8, "promoted"), (0.6, "rejected")])
def test_a_network_that_was_brought_is_used_until_its_student_is_promoted(
    shell: duckdb.DuckDBPyConnection, share: float, state: str
) -> None:
    shell.execute("delete from models")
    add_model(shell, "brought", "elsewhere")
    assert states(shell) == {"brought": ("brought", True)}
    add_model(shell, "student", "brought")
    assert states(shell) == {"brought": ("brought", True), "student": ("unchecked", False)}
    add_check(shell, "student", "brought", (share, 0.04), (0.7, 0.05))
    assert states(shell) == {
        "brought": ("brought", state == "rejected"),
        "student": (state, state == "promoted"),
    }
