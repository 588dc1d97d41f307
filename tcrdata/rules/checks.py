"""The view `checks`: what each rule of each selection says of each proposal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.judging import scoped

_ALL = "of_round_"  # before a table's name: its rows of the selection's round


def checks_view_sql(selections: Sequence[Mapping[str, Any]]) -> str:
    """SQL of the view `checks` over selections that read one snapshot.

    One branch a selection and rule. The first columns are literals, so a filter on
    `selection_id`, `selection` or `rule` leaves the other branches unread. Tables are named
    without a schema: make the view beside those of the selections' snapshot.

    Args:
        selections: rows of `selections`, at least one.
    """
    return "\nunion all\n".join(
        _branch(selection, rule, text)
        for selection in selections
        for rule, text in zip(selection["rules"], selection["rule_texts"], strict=True)
    )


def _branch(selection: Mapping[str, Any], rule: str, text: str) -> str:
    """What one rule of one selection says, over the selection's round."""
    number = int(selection["round"])
    rounds = ",\n".join(
        f"{_ALL}{table} as not materialized (select * from {table} where round = {number})"
        for table in EVIDENCE_TABLES
    )
    verdicts = scoped(text, EVIDENCE_TABLES, {table: _ALL + table for table in EVIDENCE_TABLES})
    literals = (selection["selection_id"], selection["name"], rule)
    quoted = ["'" + value.replace("'", "''") + "'" for value in literals]
    return (
        f"select {quoted[0]} as selection_id, {quoted[1]} as selection, proposal_id, "
        f"{quoted[2]} as rule, value, bound, passed\n"
        f"from (with {rounds}\nselect * from (\n{verdicts}\n))"
    )
