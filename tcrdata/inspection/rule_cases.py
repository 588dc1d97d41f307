"""Given and expected: runs rules on the rows of their case files and says where they differ.

A folder of rules has `rules/<rule>.sql` and `cases/<rule>.toml`, as `queries/` has; where it has no
folder `rules`, both lie in the folder itself. A case file is a list of cases:

    [[case]]
    name = "at the bound, beyond"
    set = { max_range_m = 30 }                                  # may be left out
    tolerance = 0.01                                            # may be left out
    given.proposals = [{ range_m = 30.0 }, { range_m = 31.0 }]  # the columns that matter
    given.egomotions = [{ frame = 0, method = "odometry" }]     # any other table of evidence
    expected = [                                                # a verdict a proposal, in order
      { value = 30.0, bound = 30.0, passed = true },
      { value = 31.0, bound = 30.0, passed = false },
    ]

What is left out of a verdict is expected to be NULL: without `passed` the rule must abstain.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from tcrdata.errors import RuleError, SettingsError
from tcrdata.resources import resource_folder
from tcrdata.rules import Rule, load_rules
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.sql_files import to_literal
from tcrdata.store import schemas
from tcrdata.store.views import quote

VERDICT = ("value", "bound", "passed")
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

_NEARLY = 1e-12  # relative: numbers of a case that sets no tolerance differ by rounding alone


@dataclass(frozen=True)
class Case:
    """One case of a rule.

    Attributes:
        path: its file.
        name: what it shows.
        given: table to rows.
        expected: a verdict for each given proposal, in their order.
        overrides: values of parameters other than the rule's own.
        tolerance: largest difference of numbers, in their own unit; 0 allows rounding alone.
    """

    path: Path
    name: str
    given: Mapping[str, list[dict[str, Any]]]
    expected: list[dict[str, Any]]
    overrides: Mapping[str, Any]
    tolerance: float


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
    """Run all cases of a folder's rules; see the module for the layout.

    Args:
        folder: holds rules of one's own; those that ship with tcrdata without one.

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


def read_cases(path: Path) -> list[Case]:
    """Read a case file.

    Raises:
        RuleError: it cannot be read, is no TOML, or a case lacks something; names both.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RuleError(f"{path}: cannot be read as TOML ({error}): correct it") from error
    cases = content.get("case")
    if not isinstance(cases, list) or not cases or set(content) != {"case"}:
        raise RuleError(f"{path}: holds no list of cases: start each with a line [[case]]")
    return [_case(path, number, case) for number, case in enumerate(cases, start=1)]


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
        raise _wrong(case, f"rule {rule.name} fails on the rows: {error}") from error
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
            raise _wrong(case, f"given.{table} is no table that rules may read: {known}")
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
                raise _wrong(case, f"given.{table}, row {number + 1}: {error}") from error
    return ids


def _case(path: Path, number: int, content: Any) -> Case:
    """One case of a file, checked."""
    content = content if isinstance(content, dict) else {}
    name = str(content.get("name", f"number {number}"))
    given, expected = content.get("given"), content.get("expected")
    case = Case(
        path, name, given if isinstance(given, dict) else {},
        expected if isinstance(expected, list) else [],
        content.get("set", {}), content.get("tolerance", 0.0),
    )  # fmt: skip
    if strangers := set(content) - {"name", "set", "tolerance", "given", "expected"}:
        raise _wrong(case, f"'{min(strangers)}' is none of name, set, tolerance, given, expected")
    proposals = case.given.get("proposals", [])
    if not proposals or len(case.expected) != len(proposals):
        raise _wrong(
            case,
            f"has {len(proposals)} given.proposals and {len(case.expected)} expected: "
            "give at least one, and a verdict for each",
        )
    if any(not isinstance(rows, list) for rows in case.given.values()):
        raise _wrong(case, "given.<table> is a list of rows: [{ column = value }, ...]")
    for verdict in case.expected:
        if not isinstance(verdict, dict) or set(verdict) - set(VERDICT):
            raise _wrong(case, f"expected {verdict}: a verdict has value, bound and passed")
    if not isinstance(case.tolerance, int | float) or not case.tolerance >= 0:
        raise _wrong(case, f"tolerance {case.tolerance}: give a number, 0 or more")
    return case


def _literals(rule: Rule, case: Case) -> dict[str, str]:
    """The case's overrides as SQL literals."""
    kinds = {parameter.name: parameter.kind for parameter in rule.parameters}
    literals = {}
    for name, value in case.overrides.items():
        if name not in kinds:
            known = ", ".join(kinds) or "none"
            raise _wrong(case, f"set.{name} is no parameter of rule {rule.name}: it has {known}")
        try:
            literals[name] = to_literal(value, kinds[name])
        except ValueError as error:
            raise _wrong(case, f"set.{name} {error}, not {value!r}") from error
    return literals


def _same(found: Any, wanted: Any, tolerance: float) -> bool:
    """Whether two values agree; booleans and NULL exactly."""
    numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in (found, wanted))
    if not numbers:
        return found is wanted
    return bool(found == wanted or math.isclose(found, wanted, rel_tol=_NEARLY, abs_tol=tolerance))


def _wrong(case: Case, message: str) -> RuleError:
    """An error that names file and case, in one line."""
    return RuleError(f"{case.path}: case '{case.name}': {' '.join(message.split())}")
