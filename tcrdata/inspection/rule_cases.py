"""Runs rules on the given rows of their cases and says where they differ from what is expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from tcrdata.errors import RuleError, SettingsError
from tcrdata.inspection.case_files import VERDICT, Case, read_cases, wrong
from tcrdata.resources import resource_folder
from tcrdata.rules import Rule, load_rules
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.parameters import to_literal
from tcrdata.store import schemas
from tcrdata.store.views import quote

KEYS: dict[str, Any] = {"dataset": "d", "sequence": "s", "round": 1}
"""Columns that every given row has, unless the case says otherwise."""

PROPOSAL: dict[str, Any] = {
    **KEYS,
    "frame": 0,
    "source": "track",
    "fit": "track",
    "region_id": "r",
    "found": "observed",
    "metric_scale": 1.0,
    "x_m": 0.0,
    "y_m": 0.0,
    "z_m": 10.0,
    "length_m": 4.0,
    "width_m": 2.0,
    "height_m": 1.5,
    "yaw_rad": 0.0,
    "range_m": 10.0,
    "number_of_points": 20,
}
"""What a given proposal is, unless the case says otherwise: a car ten metres ahead."""

_NEARLY = 1e-12  # relative: rounding


@dataclass(frozen=True)
class Difference:
    """Where a rule says something else than its case.

    Attributes:
        rule: name of the rule.
        case: name of the case.
        proposal: its place among the given ones, 1-based.
        what: value, bound, passed, or rows: the rule gives not one row a proposal.
        expected: what the case wants; None is NULL.
        found: what the rule gives.
    """

    rule: str
    case: str
    proposal: int
    what: str
    expected: Any
    found: Any


@dataclass(frozen=True)
class CaseResults:
    """What came of the cases of some rules.

    Attributes:
        cases: rule to number of its cases; 0 where it has none. Sorted by name.
        differences: by rule, case and proposal; empty when every case holds.
    """

    cases: dict[str, int]
    differences: tuple[Difference, ...]

    @property
    def untested(self) -> tuple[str, ...]:
        """Rules without a case."""
        return tuple(rule for rule, count in self.cases.items() if not count)


def run_cases(folder: str | None = None) -> CaseResults:
    """Run all cases of a folder's rules.

    Args:
        folder: of one's own: `rules/<rule>.sql` and `cases/<rule>.toml`, as `queries/` has, or both
            in the folder itself; the rules that ship with tcrdata without one.

    Raises:
        SettingsError: the folder is not there or holds no rule.
        RuleError: a rule or a case file is wrong; names file and case.
    """
    rules_in, cases_in = rule_folders(folder)
    rules = load_rules(rules_in)
    tested = sorted({path.stem for path in rules_in.glob("*.sql")})
    cases = {path.stem: read_cases(path) for path in sorted(cases_in.glob("*.toml"))}
    for name in cases:
        if name not in rules:
            raise RuleError(
                f"{cases_in / name}.toml: there is no rule '{name}' in {rules_in}: "
                f"write {name}.sql there, or name the cases after their rule"
            )
    differences = [
        difference
        for name in sorted(cases)
        for case in cases[name]
        for difference in run_case(rules[name], case)
    ]
    names = sorted({*tested, *cases})
    return CaseResults({name: len(cases.get(name, [])) for name in names}, tuple(differences))


def rule_folders(folder: str | None) -> tuple[Path, Path]:
    """Return where a folder's rules and where their cases lie.

    Raises:
        SettingsError: the folder is not there or holds no rule.
    """
    base = resource_folder("queries") if folder is None else Path(folder)
    if not base.is_dir():
        raise SettingsError(f"{folder} is no folder: give one with rules/*.sql and cases/*.toml")
    rules = base / "rules" if (base / "rules").is_dir() else base
    cases = base / "cases" if (base / "cases").is_dir() else rules
    if not any(rules.glob("*.sql")):
        raise SettingsError(
            f"{base} holds no rule: put them into {base / 'rules'}/<rule>.sql and their cases "
            f"into {base / 'cases'}/<rule>.toml"
        )
    return rules, cases


def run_case(
    rule: Rule, case: Case, connection: duckdb.DuckDBPyConnection | None = None
) -> list[Difference]:
    """Judge the given proposals and compare; an empty list when the case holds.

    Args:
        rule: to judge with.
        case: of that rule.
        connection: with empty tables of evidence, which stay filled; one of its own without.

    Raises:
        RuleError: a given row does not fit its table, an override names no parameter of the rule,
            or the rule fails on the rows.
    """
    if connection is None:
        with duckdb.connect() as own:
            for table in EVIDENCE_TABLES:
                own.execute(schemas.ddl(table))
            return run_case(rule, case, own)
    ids = fill_tables(connection, case)
    try:
        rows = connection.execute(rule.select(_literals(rule, case))).fetchall()
    except duckdb.Error as error:
        raise wrong(case, f"rule {rule.name} fails on the rows: {error}") from error
    found = {proposal_id: verdict for proposal_id, *verdict in rows}
    if len(rows) != len(ids) or set(found) != set(ids):
        return [Difference(rule.name, case.name, len(ids), "rows", len(ids), len(rows))]
    return [
        Difference(rule.name, case.name, place, what, wanted.get(what), value)
        for place, (proposal_id, wanted) in enumerate(zip(ids, case.expected, strict=True), start=1)
        for what, value in zip(VERDICT, found[proposal_id], strict=True)
        if not _same(value, wanted.get(what), case.tolerance)
    ]


def fill_tables(connection: duckdb.DuckDBPyConnection, case: Case) -> list[str]:
    """Insert the given rows; return the ids of the proposals, in their order.

    Raises:
        RuleError: a row does not fit its table.
    """
    ids = []
    for table, rows in case.given.items():
        if table not in EVIDENCE_TABLES:
            known = ", ".join(EVIDENCE_TABLES)
            raise wrong(case, f"given.{table} is no table that rules may read: {known}")
        for number, row in enumerate(rows):
            whole = {**KEYS, **row}
            if table == "proposals":
                whole = {**PROPOSAL, "proposal_id": f"p{number:03d}", **row}
                ids.append(str(whole["proposal_id"]))
            names = ", ".join(map(quote, whole))
            marks = ", ".join("?" for _ in whole)
            try:
                connection.execute(
                    f"insert into {table} ({names}) values ({marks})", list(whole.values())
                )
            except duckdb.Error as error:
                raise wrong(case, f"given.{table}, row {number + 1}: {error}") from error
    return ids


def _literals(rule: Rule, case: Case) -> dict[str, str]:
    """The case's overrides as SQL literals."""
    kinds = {parameter.name: parameter.kind for parameter in rule.parameters}
    literals = {}
    for name, value in case.overrides.items():
        if name not in kinds:
            known = ", ".join(kinds) or "none"
            raise wrong(case, f"set.{name} is no parameter of rule {rule.name}: it has {known}")
        try:
            literals[name] = to_literal(value, kinds[name])
        except ValueError as error:
            raise wrong(case, f"set.{name} {error}, not {value!r}") from error
    return literals


def _same(found: Any, wanted: Any, tolerance: float) -> bool:
    """Whether two values agree; booleans and NULL exactly."""
    numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in (found, wanted))
    if not numbers:
        return found is wanted
    return bool(found == wanted or math.isclose(found, wanted, rel_tol=_NEARLY, abs_tol=tolerance))
