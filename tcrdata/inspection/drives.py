"""One drive of a store as a selection saw it, opened without a look at the other drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import duckdb

from tcrdata.rules import checks_view_sql
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.store import FileEntry, Store
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.views import connect, create_views, quote


def drive_connection(
    store: Store, selection: Mapping[str, Any], dataset: str, sequence: str
) -> duckdb.DuckDBPyConnection:
    """Return views over one drive: the evidence that a selection read, all selections and labels.

    `checks` is not among them: `judge` makes it, over the proposals in question.

    Args:
        store: that holds the selection.
        selection: its row of `selections`.
        dataset: the drive's.
        sequence: the drive.
    """
    files = Filesystem(store.url)
    of_any = {
        table: store.files(table, dataset=dataset, sequence=sequence)
        for table in ("labels", "selections")
    }
    tables: dict[str, Sequence[FileEntry]] = dict(_evidence(store, selection, dataset, sequence))
    connection = connect(files, {**tables, "selections": of_any["selections"]}, {})
    create_views(connection, files, {"labels": of_any["labels"]}, {}, "of_any_drive")
    names = ["'" + name.replace("'", "''") + "'" for name in (dataset, sequence)]
    own = f"dataset = {names[0]} and sequence = {names[1]}"
    views = {"labels": f"select * from of_any_drive.labels where {own}"}
    create_views(connection, files, {}, views)
    return connection


def selections_of(store: Store, dataset: str, sequence: str, round: int) -> list[dict[str, Any]]:
    """Return the rows of `selections` of a round, found through one drive's records."""
    rows = store.read("selections", dataset=dataset, sequence=sequence).to_pylist()
    return [row for row in rows if row["round"] == round]


def judge(
    connection: duckdb.DuckDBPyConnection,
    store: Store,
    selections: Sequence[Mapping[str, Any]],
    place: tuple[str, str],
    frame: int,
    track_id: str | None = None,
) -> None:
    """Make the view `checks` over the proposals of a frame and of a track.

    Each selection judges the rows that it read, as in `tcrdata.open`.

    Args:
        connection: of `drive_connection`; an earlier `checks` of it is replaced.
        store: that holds the selections.
        selections: rows of `selections`.
        place: dataset and sequence.
        frame: whose proposals are judged.
        track_id: whose proposals are judged in all frames; None for no track.
    """
    files = Filesystem(store.url)
    parts = []
    for number, snapshot in enumerate(sorted({row["snapshot"] for row in selections})):
        rows = [row for row in selections if row["snapshot"] == snapshot]
        evidence = _evidence(store, rows[0], *place)
        read, judged = f"read_{number}", f"judged_{number}"
        for schema in (judged, read):
            connection.execute(f"drop schema if exists {schema} cascade")
        create_views(connection, files, evidence, {}, read)
        connection.execute(f"create schema {judged}")
        connection.execute(
            f"create table {judged}.proposals as "
            f"select * from {read}.proposals where frame = $1 or track_id = $2",
            [frame, track_id],
        )
        views = {table: f"from {read}.{quote(table)}" for table in evidence if table != "proposals"}
        views["checks"] = checks_view_sql(rows)
        create_views(connection, files, {}, views, judged)
        parts.append(f"from {judged}.checks")
    create_views(connection, files, {}, {"checks": " union all ".join(parts)})


def _evidence(
    store: Store, selection: Mapping[str, Any], dataset: str, sequence: str
) -> dict[str, list[FileEntry]]:
    """The files of one drive that a selection read, a list a table."""
    chosen: dict[str, list[FileEntry]] = {table: [] for table in EVIDENCE_TABLES}
    wanted = (dataset, sequence, selection["round"])
    for entry in store.snapshot(selection["snapshot"]).files:
        unit = entry.unit
        if entry.table in chosen and (unit.dataset, unit.sequence, unit.round) == wanted:
            chosen[entry.table].append(entry)
    return chosen
