"""Every file of SQL says what it is, explains its parameters, and runs as it is in a shell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import duckdb
import pytest

from tcrdata.resources import resource_files

SCHEMAS = resource_files("schemas/*.sql")
RULES = resource_files("queries/rules/*.sql")
PRESETS = resource_files("queries/presets/*.sql")
REPORTS = resource_files("queries/reports/*.sql")
TRAINING = resource_files("queries/training/*.sql")
STATES = resource_files("queries/states/*.sql")
TRACKING = resource_files("queries/tracking/*.sql")
SETTER = re.compile(r"^set variable (\w+) = .*?;\s*(?:--\s*(.*))?$", re.MULTILINE)


def named(path: Path) -> str:
    return f"{path.parent.name}/{path.name}"


def setters(path: Path) -> dict[str, str]:
    """Parameter to comment."""
    found = SETTER.findall(path.read_text())
    assert len(found) == len(re.findall(r"(?im)^\s*set ", path.read_text()))
    return dict(found)


@pytest.fixture(scope="module")
def tables() -> Iterator[duckdb.DuckDBPyConnection]:
    """A plain connection with an empty table of each schema."""
    with duckdb.connect() as connection:
        for path in SCHEMAS:
            connection.execute(path.read_text())
        for accepted in ("accepted", "acceptable"):
            connection.execute(f"create table {accepted} as select *, 0 as place from labels")
        yield connection


@pytest.fixture
def shell(tables: duckdb.DuckDBPyConnection) -> Iterator[duckdb.DuckDBPyConnection]:
    """The tables, and no variable that another file has set."""
    with tables.cursor() as cursor:
        yield cursor


def test_no_file_of_sql_lies_elsewhere(repository: Path) -> None:
    known = {*SCHEMAS, *RULES, *PRESETS, *REPORTS, *TRAINING, *STATES, *TRACKING}
    found = {path for name in ("schemas", "queries") for path in (repository / name).rglob("*.sql")}
    assert found == known


@pytest.mark.parametrize(
    "path", [*SCHEMAS, *RULES, *PRESETS, *REPORTS, *TRAINING, *STATES, *TRACKING], ids=named
)
def test_a_file_opens_with_what_it_decides_or_holds(path: Path) -> None:
    first = path.read_text().splitlines()[0]
    assert first.startswith("-- ")
    assert ": " not in first[:12], "the header's first line is a sentence, not a field"
    assert len(first.split()) >= 4


@pytest.mark.parametrize("path", [*RULES, *REPORTS, *TRAINING, *TRACKING], ids=named)
def test_a_parameter_has_a_unit_or_a_meaning(path: Path) -> None:
    assert [name for name, comment in setters(path).items() if len(comment.split()) < 2] == []


@pytest.mark.parametrize("path", PRESETS, ids=named)
def test_a_preset_sets_what_a_rule_explains_or_explains_it(path: Path) -> None:
    explained = {name for rule in RULES for name in setters(rule)}
    assert [
        name for name, text in setters(path).items() if not text and name not in explained
    ] == []


@pytest.mark.parametrize(
    "path", [*RULES, *PRESETS, *REPORTS, *TRAINING, *STATES, *TRACKING], ids=named
)
def test_a_file_runs_as_it_is_over_empty_tables(
    shell: duckdb.DuckDBPyConnection, path: Path
) -> None:
    assert shell.execute(path.read_text()).fetchall() == []
    assert shell.description


@pytest.mark.parametrize("path", [*REPORTS, *TRAINING, *TRACKING], ids=named)
def test_a_report_uses_every_parameter_it_sets(path: Path) -> None:
    text = path.read_text()
    assert {name for name in setters(path) if f"getvariable('{name}')" not in text} == set()
    assert set(re.findall(r"getvariable\('(\w+)'\)", text)) == set(setters(path))
