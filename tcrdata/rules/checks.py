"""The views `checks` and `verdicts`: what the rules of each selection say of each proposal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.rounds import of_round
from tcrdata.rules.scopes import quoted, scoped
from tcrdata.rules.verdicts import verdicts_selects

if TYPE_CHECKING:
    import duckdb

    from tcrdata.store import Store

_ALL = "of_round_"  # before a table's name: its rows of the selection's round


def add_rule_views(
    store: Store,
    connection: duckdb.DuckDBPyConnection,
    selections: Sequence[Mapping[str, Any]],
) -> None:
    """Replace the empty tables `checks` and `verdicts` of a connection by views.

    Each selection is judged over the files that it was made from, not over newer ones.

    Args:
        store: the connection's.
        connection: of `Store.connect`; gets a schema a snapshot.
        selections: rows of `selections`; nothing is done without one.

    Raises:
        StoreError: a selection's snapshot is gone, or one of its files is damaged.
        QueryError: a rule's text does not bind.
    """
    branches: dict[str, list[str]] = {"checks": [], "verdicts": []}
    for number, snapshot in enumerate(sorted({row["snapshot"] for row in selections})):
        rows = [row for row in selections if row["snapshot"] == snapshot]
        views = {"checks": checks_view_sql(rows), "verdicts": verdicts_view_sql(rows)}
        schema = f"snapshot_{number}"
        store.add_snapshot(connection, snapshot, schema, views, tables=EVIDENCE_TABLES)
        for view, selects in branches.items():
            selects.append(f"select * from {schema}.{view}")
    for view, selects in branches.items():
        if selects:
            connection.execute(f"drop table if exists {view}")
            connection.execute(f"create view {view} as " + " union all ".join(selects))


def checks_view_sql(selections: Sequence[Mapping[str, Any]], *, one_round: bool = False) -> str:
    """SQL of the view `checks` over selections that read one snapshot.

    One branch a selection and rule. The first columns are literals, so a filter on
    `selection_id`, `selection` or `rule` leaves the other branches unread. Tables are named
    without a schema: make the view beside those of the selections' snapshot.

    Args:
        selections: rows of `selections`, at least one.
        one_round: the tables hold rows of the selections' round alone, so need no filter; without
            it DuckDB binds the view four times as fast.
    """
    return "\nunion all\n".join(
        _branch(selection, rule, text if one_round else _of_its_round(selection, text))
        for selection in selections
        for rule, text in zip(selection["rules"], selection["rule_texts"], strict=True)
    )


def verdicts_view_sql(selections: Sequence[Mapping[str, Any]]) -> str:
    """SQL of the view `verdicts`, one branch a selection; see `checks_view_sql`."""
    return "\nunion all\n".join(verdicts_selects(selections))


def _branch(selection: Mapping[str, Any], rule: str, verdicts: str) -> str:
    """What one rule of one selection says."""
    literals = (selection["selection_id"], selection["name"], rule)
    selection_id, name, its_rule = map(quoted, literals)
    return (
        f"select {selection_id} as selection_id, {name} as selection, proposal_id, "
        f"{its_rule} as rule, value, bound, passed\nfrom (\n{verdicts}\n)"
    )


def _of_its_round(selection: Mapping[str, Any], text: str) -> str:
    """A rule's select over the rows of the selection's round."""
    number = int(selection["round"])
    rounds = ",\n".join(
        f"{_ALL}{table} as not materialized {of_round(table, number)}" for table in EVIDENCE_TABLES
    )
    verdicts = scoped(text, EVIDENCE_TABLES, {table: _ALL + table for table in EVIDENCE_TABLES})
    return f"with {rounds}\nselect * from (\n{verdicts}\n)"
