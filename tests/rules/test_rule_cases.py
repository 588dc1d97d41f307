"""Each rule decides what its case file says, as it is in a shell and as the loader fills it in."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import duckdb
import pytest
from rule_worlds import KEYS, insert, proposal_rows

from tcrdata.rules import load_preset, load_rules, preset_names
from tcrdata.rules.rule_files import Rule
from tcrdata.rules.sql_files import to_literal

CASES = Path(__file__).resolve().parents[1] / "cases" / "rules"
RULES = load_rules()


def cases() -> list[Any]:
    return [
        pytest.param(name, case, id=f"{name}: {case['name']}")
        for name in RULES
        if (CASES / f"{name}.toml").is_file()
        for case in tomllib.loads((CASES / f"{name}.toml").read_text())["case"]
    ]


def filled(rule: Rule, case: dict[str, Any]) -> str:
    kinds = {p.name: p.kind for p in rule.parameters}
    return rule.select({n: to_literal(v, kinds[n]) for n, v in case.get("set", {}).items()})


def fill_tables(shell: duckdb.DuckDBPyConnection, case: dict[str, Any]) -> None:
    given = dict(case["given"])
    insert(shell, "proposals", proposal_rows(given.pop("proposals")))
    for table, rows in given.items():
        insert(shell, table, [{**KEYS, **row} for row in rows])


def as_it_is(shell: duckdb.DuckDBPyConnection, rule: Rule, case: dict[str, Any]) -> list[Any]:
    """Run the file in a shell; a case's parameters are set between its two halves."""
    *settings, select = duckdb.extract_statements(rule.file.path.read_text())
    for statement in settings:
        shell.execute(statement)
    for name, value in case.get("set", {}).items():
        literal = to_literal(value, "text" if isinstance(value, str) else "number")
        shell.execute(f"set variable {name} = {literal}")
    return shell.execute(select).fetchall()


def same(found: float | None, wanted: float | None) -> bool:
    if found is None or wanted is None:
        return found is wanted
    return math.isclose(found, wanted, rel_tol=1e-12) or found == wanted


@pytest.mark.parametrize(("name", "case"), cases())
def test_rule_decides_as_its_case_says(
    shell: duckdb.DuckDBPyConnection, name: str, case: dict[str, Any]
) -> None:
    fill_tables(shell, case)
    rows = sorted(shell.execute(filled(RULES[name], case)).fetchall())
    assert len(rows) == len(case["expected"])
    for (proposal, value, bound, passed), wanted in zip(rows, case["expected"], strict=True):
        assert same(value, wanted.get("value")), f"{proposal}: value {value}"
        assert same(bound, wanted.get("bound")), f"{proposal}: bound {bound}"
        assert passed is wanted.get("passed"), proposal
    assert sorted(as_it_is(shell, RULES[name], case)) == rows


@pytest.mark.parametrize("name", RULES)
def test_every_rule_has_cases_that_pass_fail_and_abstain(name: str) -> None:
    path = CASES / f"{name}.toml"
    assert path.is_file(), f"write {path}: given rows and the expected verdicts of rule {name}"
    verdicts = [
        e.get("passed") for c in tomllib.loads(path.read_text())["case"] for e in c["expected"]
    ]
    assert {True, False} <= set(verdicts)
    abstains = name not in ("source", "range", "height")  # these judge every proposal
    assert (None in verdicts) is abstains


def test_no_case_file_without_a_rule() -> None:
    assert {path.stem for path in CASES.glob("*.toml")} <= set(RULES)


@pytest.mark.parametrize("name", preset_names())
def test_preset_runs_as_it_is_in_a_shell(shell: duckdb.DuckDBPyConnection, name: str) -> None:
    preset = load_preset(name)
    for rule in preset.rules:
        shell.execute(rule.file.path.read_text())
    columns = [column[0] for column in shell.execute(preset.file.path.read_text()).description]
    assert columns == ["proposal_id", "state", "score"]
