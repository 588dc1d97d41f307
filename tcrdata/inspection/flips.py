"""Looks for the parameter that would let a rule pass a proposal, and tries it on the very row."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import Any

import duckdb

from tcrdata.rules import Rule
from tcrdata.rules.binding import EVIDENCE_TABLES, KEY_COLUMNS
from tcrdata.rules.judging import scoped
from tcrdata.store import schemas

_DIGITS = 3
_NUMBERS = ("DOUBLE", "INTEGER")


def passing_value(
    connection: duckdb.DuckDBPyConnection,
    rule: Rule,
    literals: Mapping[str, str],
    proposal_id: str,
    measured: float | None,
) -> tuple[str, str] | None:
    """Return the parameter, and its value nearest to the present one, with which the rule passes.

    What the rule measured and the columns of the proposal that it reads are tried as values, and
    numbers of few digits beside them; the rule itself says which of them pass.

    Args:
        connection: views of the evidence that the selection read.
        rule: that stops the proposal.
        literals: parameter to its literal in the selection.
        proposal_id: the proposal.
        measured: the rule's value; None when it has none.

    Returns:
        Parameter and value; None when no number of one parameter alone does it.
    """
    row = _row(connection, proposal_id)
    scale = float(row["metric_scale"])
    read = [
        row[name]
        for name, kind, _ in schemas.columns("proposals")
        if name in rule.reads.columns and name not in KEY_COLUMNS and kind.upper() in _NUMBERS
    ]
    for numbers in ([measured], read):
        values = sorted({v for number in numbers for v in _near(number, scale)})
        found = _nearest_passing(connection, rule, literals, proposal_id, values)
        if found is not None:
            return found
    return None


def _row(connection: duckdb.DuckDBPyConnection, proposal_id: str) -> dict[str, Any]:
    rows = connection.sql("from proposals where proposal_id = $id", params={"id": proposal_id})
    return dict(rows.to_arrow_table().to_pylist()[0])


def _near(number: float | None, scale: float) -> Iterable[Decimal]:
    """A number as it is and by the drive's scale, and numbers of three digits on both sides."""
    if number is None or not math.isfinite(number):
        return
    for exact in (Decimal(repr(float(number))), Decimal(repr(float(number) / scale))):
        place = exact.adjusted() if exact else 0
        step = Decimal(1).scaleb(place - _DIGITS + 1)
        down = (exact / step).to_integral_value("ROUND_FLOOR") * step
        up = (exact / step).to_integral_value("ROUND_CEILING") * step
        yield from (exact, down, up, down - step, up + step)


def _nearest_passing(
    connection: duckdb.DuckDBPyConnection,
    rule: Rule,
    literals: Mapping[str, str],
    proposal_id: str,
    values: list[Decimal],
) -> tuple[str, str] | None:
    """Of values of parameters the one that passes and changes least, short ones first."""
    one = {t: t for t in EVIDENCE_TABLES}
    one["proposals"] = "proposals where proposal_id = $id"
    branches = []
    for parameter in rule.parameters:
        present = literals.get(parameter.name, parameter.literal)
        for value in values if parameter.kind == "number" else ():
            text = format(value.normalize() + 0, "f")
            changed = rule.select({**literals, parameter.name: text})
            few = len(value.normalize().as_tuple().digits) <= _DIGITS
            branches.append(
                f"select '{parameter.name}' as parameter, '{text}' as value, {few} as short, "
                f"abs({text} - {present}::double) / greatest(abs({present}), 1e-9) as change "
                f"from ({scoped(changed, rule.reads.tables, one)}) where passed"
            )
    if not branches:
        return None
    rows = connection.execute(
        "select parameter, value from (" + "\nunion all\n".join(branches) + ") "
        "order by not short, change, parameter limit 1",
        {"id": proposal_id},
    ).fetchall()
    return (str(rows[0][0]), str(rows[0][1])) if rows else None
