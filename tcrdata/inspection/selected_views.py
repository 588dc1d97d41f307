"""Connections that hold what some selections saw and said, and nothing else of the store."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.checks import verdicts_view_sql
from tcrdata.rules.verdicts import columns_read

if TYPE_CHECKING:
    import duckdb

    from tcrdata.store import Store

_OF_THIS_MOMENT = ("labels", "selections")


def selection_rows(store: Store, *selection_ids: str) -> list[dict[str, Any]]:
    """Return the rows of `selections` with these ids, in their order."""
    rows = {row["selection_id"]: row for row in store.read("selections").to_pylist()}
    return [rows[selection_id] for selection_id in selection_ids]


def connect_selections(
    store: Store, selections: Sequence[dict[str, Any]], asked: str | None = None
) -> duckdb.DuckDBPyConnection:
    """Connect to the labels of all selections, and to the evidence and verdicts of some.

    Reading less than `tcrdata.open` it answers sooner on a store of thousands of files. The
    evidence tables are those that the first of the selections read.

    Args:
        store: that holds them.
        selections: rows of `selections`, at least one.
        asked: a select over labels of the ids of the only proposals to judge; None for all.

    Raises:
        StoreError: a selection's snapshot is gone, or one of its files is damaged.
    """
    connection = store.connect(tables=_OF_THIS_MOMENT)
    if asked is not None:
        connection.execute(f"create table asked as {asked}")
    parts: list[str] = []
    for number, snapshot in enumerate(dict.fromkeys(row["snapshot"] for row in selections)):
        rows = [row for row in selections if row["snapshot"] == snapshot]
        schema = f"snapshot_{number}" if number else "main"
        store.add_snapshot(connection, snapshot, schema, tables=EVIDENCE_TABLES)
        if asked is not None:
            schema = _narrow(connection, schema, rows, f"asked_{number}")
        view = f"{schema}.verdicts_{number}"
        connection.execute(f"use {schema}")
        connection.execute(f"create view {view} as {verdicts_view_sql(rows)}")
        parts.append(f"from {view}")
    connection.execute("use main")
    connection.execute("create view verdicts as " + " union all ".join(parts))
    return connection


def _narrow(
    connection: duckdb.DuckDBPyConnection, schema: str, rows: Sequence[dict[str, Any]], name: str
) -> str:
    """Make a schema with the evidence of another, of the asked proposals alone."""
    columns = ", ".join(columns_read(rows))
    connection.execute(f"create schema {name}")
    for table in EVIDENCE_TABLES:
        if table != "proposals":
            connection.execute(f"create view {name}.{table} as from {schema}.{table}")
    # Read once and kept: the proposals are few, the files are many.
    connection.execute(
        f"create table {name}.proposals as "
        f"select {columns} from {schema}.proposals semi join main.asked using (proposal_id)"
    )
    return name
