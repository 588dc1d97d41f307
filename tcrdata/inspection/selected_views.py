"""Connections that hold what some selections saw and said, and nothing else of the store."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.checks import verdicts_view_sql

if TYPE_CHECKING:
    import duckdb

    from tcrdata.store import Store

_OF_THIS_MOMENT = ("labels", "selections")


def selection_rows(store: Store, *selection_ids: str) -> list[dict[str, Any]]:
    """Return the rows of `selections` with these ids, in their order."""
    rows = {row["selection_id"]: row for row in store.read("selections").to_pylist()}
    return [rows[selection_id] for selection_id in selection_ids]


def connect_selections(
    store: Store, selections: Sequence[dict[str, Any]]
) -> duckdb.DuckDBPyConnection:
    """Connect to the labels of all selections, and to the evidence and verdicts of some.

    Reading less than `tcrdata.open` it answers sooner on a store of thousands of files. The
    evidence tables are those that the first of the selections read.

    Args:
        store: that holds them.
        selections: rows of `selections`, at least one.

    Raises:
        StoreError: a selection's snapshot is gone, or one of its files is damaged.
    """
    connection = store.connect(tables=_OF_THIS_MOMENT)
    first = selections[0]["snapshot"]
    parts: list[str] = []
    for snapshot in dict.fromkeys(row["snapshot"] for row in selections):
        rows = [row for row in selections if row["snapshot"] == snapshot]
        schema = "main" if snapshot == first else f"snapshot_{len(parts)}"
        views = {f"verdicts_{len(parts)}": verdicts_view_sql(rows)}
        store.add_snapshot(connection, snapshot, schema, views, tables=EVIDENCE_TABLES)
        parts.append(f"from {schema}.verdicts_{len(parts)}")
    connection.execute("create view verdicts as " + " union all ".join(parts))
    return connection
