"""Each rule decides what its case file says, as it is in a shell and as the loader fills it in."""

from __future__ import annotations

from typing import Any

import duckdb
import pytest

from tcrdata.inspection.case_files import Case, read_cases
from tcrdata.inspection.rule_cases import run_case
from tcrdata.resources import resource_files
from tcrdata.rules import load_preset, load_rules, preset_names
from tcrdata.rules.parameters import to_literal
from tcrdata.rules.rule_files import Rule

CASES = {path.stem: read_cases(path) for path in resource_files("queries/cases/*.toml")}
RULES = load_rules()


def cases() -> list[Any]:
    return [
        pytest.param(RULES[name], case, id=f"{name}: {case.name}")
        for name, of_rule in CASES.items()
        for case in of_rule
    ]


def as_it_is(shell: duckdb.DuckDBPyConnection, rule: Rule, case: Case) -> list[Any]:
    """Run the file in a shell; a case's parameters are set between its two halves."""
    *settings, select = duckdb.extract_statements(rule.file.path.read_text())
    for statement in settings:
        shell.execute(statement)
    for name, value in case.overrides.items():
        literal = to_literal(value, "text" if isinstance(value, str) else "number")
        shell.execute(f"set variable {name} = {literal}")
    return shell.execute(select).fetchall()


@pytest.mark.parametrize(("rule", "case"), cases())
def test_rule_decides_as_its_case_says(
    shell: duckdb.DuckDBPyConnection, rule: Rule, case: Case
) -> None:
    assert run_case(rule, case, shell) == []
    kinds = {p.name: p.kind for p in rule.parameters}
    literals = {name: to_literal(value, kinds[name]) for name, value in case.overrides.items()}
    filled = shell.execute(rule.select(literals)).fetchall()
    assert sorted(as_it_is(shell, rule, case)) == sorted(filled)
    assert len(filled) == len(case.expected)


@pytest.mark.parametrize("name", RULES)
def test_every_rule_has_cases_that_pass_fail_and_abstain(name: str) -> None:
    assert name in CASES, f"write queries/cases/{name}.toml: given rows and expected verdicts"
    verdicts = [verdict.get("passed") for case in CASES[name] for verdict in case.expected]
    assert {True, False} <= set(verdicts)
    abstains = name not in ("source", "range", "height")  # these judge every proposal
    assert (None in verdicts) is abstains


def test_no_case_file_without_a_rule() -> None:
    assert set(CASES) <= set(RULES)


@pytest.mark.parametrize("name", preset_names())
def test_preset_runs_as_it_is_in_a_shell(shell: duckdb.DuckDBPyConnection, name: str) -> None:
    preset = load_preset(name)
    for rule in preset.rules:
        shell.execute(rule.file.path.read_text())
    columns = [column[0] for column in shell.execute(preset.file.path.read_text()).description]
    assert columns == ["proposal_id", "state", "score"]
