"""Looks for the parameter that would let a rule pass a proposal, and tries it on the very row."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from decimal import Decimal

import duckdb

from tcrdata.reports import report_rows
from tcrdata.rules import RuleText
from tcrdata.rules.binding import EVIDENCE_TABLES, KEY_COLUMNS
from tcrdata.rules.scopes import scoped
from tcrdata.store import schemas

_DIGITS = 3
_NUMBERS = ("DOUBLE", "INTEGER")
_TRIED = "tried_"  # before a table's name: what of it concerns the proposal, in memory


def hold_ready(
    connection: duckdb.DuckDBPyConnection, proposal_id: str, rules: Sequence[RuleText]
) -> None:
    """Copy into memory what `passing_value` tries rules on.

    Args:
        connection: views of one drive's evidence that the selection read.
        proposal_id: the proposal.
        rules: that are tried.
    """
    for table in EVIDENCE_TABLES:
        if not any(_names(rule, table) for rule in rules):
            continue
        own = "where proposal_id = $1" if _has_id(table) else ""
        connection.execute(
            f"create or replace temp table {_TRIED}{table} as select * from {table} {own}",
            [proposal_id] if own else [],
        )


def passing_value(
    connection: duckdb.DuckDBPyConnection,
    rule: RuleText,
    literals: Mapping[str, str],
    measured: float | None,
) -> tuple[str, str] | None:
    """Return the parameter, and its value nearest to the present one, with which the rule passes.

    Tried are what the rule measured, then the columns of the proposal that it reads, and numbers of
    few digits beside them, which go first; the rule itself says which of them pass.

    Args:
        connection: made ready by `hold_ready`.
        rule: that stops the proposal.
        literals: parameter to its literal in the selection.
        measured: the rule's value; None when it has none.

    Returns:
        Parameter and value; None when no number of one parameter alone does it.
    """
    numbers = [parameter for parameter in rule.parameters if parameter.kind == "number"]
    values = _values(connection, rule, measured)
    if not numbers or not values:
        return None
    relations = {table: _TRIED + table for table in EVIDENCE_TABLES if _names(rule, table)}
    branches = []
    for parameter in numbers:
        # The value stands where the parameter stood: one query tries them all.
        verdict = rule.select({**literals, parameter.name: "tried_values.tried_value"})
        present = literals.get(parameter.name, parameter.literal)
        branches.append(
            f"select '{parameter.name}' as parameter, tried_values.*, {present} as present, passed "
            f"from tried_values, lateral ({scoped(verdict, tuple(relations), relations)})"
        )
    trials = (
        f"with tried_values(text, tried_value, place, few_digits) as (values {', '.join(values)})\n"
        + "\nunion all\n".join(branches)
    )
    rows = report_rows(connection, "why_trials", {"trials": trials})
    if not rows:
        return None
    parameter, value, *_ = rows[0].values()
    return str(parameter), str(value)


def _values(
    connection: duckdb.DuckDBPyConnection, rule: RuleText, measured: float | None
) -> list[str]:
    """Rows of values to try: text, number, 1 for the measured one, whether it has few digits."""
    scale, read = _columns_read(connection, rule)
    places: dict[Decimal, int] = {}
    for place, numbers in enumerate(([measured], read), start=1):
        for number in numbers:
            if number is not None and math.isfinite(number):
                for exact in (Decimal(repr(float(number))), Decimal(repr(float(number) / scale))):
                    for value in (exact, *_beside(exact)):
                        places.setdefault(value.normalize() + 0, place)
    return [
        f"('{value:f}', {value:f}::double, {place}, {len(value.as_tuple().digits) <= _DIGITS})"
        for value, place in places.items()
    ]


def _names(rule: RuleText, name: str) -> bool:
    """Whether a table or column is among the words of a rule's select."""
    return re.search(rf"\b{name}\b", rule.file.select, re.IGNORECASE) is not None


def _has_id(table: str) -> bool:
    return any(column.name == "proposal_id" for column in schemas.columns(table))


def _columns_read(
    connection: duckdb.DuckDBPyConnection, rule: RuleText
) -> tuple[float, Sequence[float | None]]:
    """The drive's scale, and the proposal's numbers that the rule reads."""
    names = [
        name
        for name, kind, _ in schemas.columns("proposals")
        if _names(rule, name) and name not in KEY_COLUMNS and kind.upper() in _NUMBERS
    ]
    row = connection.execute(
        f"select {', '.join(['metric_scale', *names])} from {_TRIED}proposals"
    ).fetchall()[0]
    return float(row[0]), row[1:]


def _beside(number: Decimal) -> tuple[Decimal, ...]:
    """Numbers of three digits on both sides of a number."""
    step = Decimal(1).scaleb((number.adjusted() if number else 0) - _DIGITS + 1)
    down = (number / step).to_integral_value("ROUND_FLOOR") * step
    up = (number / step).to_integral_value("ROUND_CEILING") * step
    return (down, up, down - step, up + step)
