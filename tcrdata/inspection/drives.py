"""One drive of a store as a selection saw it, opened without a look at the other drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import count
from typing import Any

import duckdb

from tcrdata.reports import plain_rows
from tcrdata.rules import checks_view_sql
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.rounds import MEASURED, rounds_read
from tcrdata.store import FileEntry, Snapshot, Store
from tcrdata.store.commits import ANY_DATASET
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.views import connect, create_views


class Drives:
    """The drives of a store as its selections saw them. Reads each snapshot once.

    Reads with DuckDB alone: nobody who asks waits for the import of Arrow.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._files = Filesystem(store.url)
        self._snapshots: dict[tuple[str, tuple[str, str] | None], Snapshot] = {}
        self._numbers = count()
        self._schemas: dict[tuple[str, int, str, str], str] = {}

    def selection(self, selection_id: str) -> dict[str, Any]:
        """Return a selection's row of `selections`."""
        (row,) = self._selections(ANY_DATASET, selection_id)
        return row

    def names(self, selection: Mapping[str, Any]) -> list[tuple[str, str]]:
        """Return dataset and sequence of every drive of which a selection read proposals."""
        units = [f.unit for f in self._snapshot(selection).files if f.table == "proposals"]
        return sorted({(unit.dataset, unit.sequence) for unit in units})

    def holds(self, selection: Mapping[str, Any], dataset: str, sequence: str) -> bool:
        """Whether a selection read proposals of a drive."""
        files = self._snapshot(selection, (dataset, sequence)).files
        return any(entry.table == "proposals" for entry in files)

    def connection(
        self, selection: Mapping[str, Any], dataset: str, sequence: str
    ) -> duckdb.DuckDBPyConnection:
        """Return views over one drive: the evidence a selection read, all selections and labels.

        `checks` is not among them: `judge` makes it, over the proposals in question.

        Args:
            selection: its row of `selections`.
            dataset: the drive's.
            sequence: the drive.
        """
        tables: dict[str, list[FileEntry]] = {
            **self._evidence(selection, dataset, sequence),
            "selections": self.store.files("selections", dataset=dataset, sequence=sequence),
        }
        connection = self._database.cursor()
        schema = f"drive_{next(self._numbers)}"
        create_views(connection, self._files, tables, {}, schema, bundled=False)
        labels = {"labels": self.store.files("labels", dataset=dataset, sequence=sequence)}
        create_views(connection, self._files, labels, {}, f"{schema}_and_others", bundled=False)
        # Names of drives hold no quotes: the store allows letters, digits and few signs.
        own = f"dataset = '{dataset}' and sequence = '{sequence}'"
        views = {"labels": f"select * from {schema}_and_others.labels where {own}"}
        create_views(connection, self._files, {}, views, schema, bundled=False)
        connection.execute(f"use {schema}")
        self._schemas[selection["snapshot"], selection["round"], dataset, sequence] = schema
        return connection

    def selections(self, dataset: str, sequence: str, round: int) -> list[dict[str, Any]]:
        """Return the rows of `selections` of a round, found through one drive's records."""
        return [row for row in self._selections(dataset, sequence) if row["round"] == round]

    def judge(
        self,
        connection: duckdb.DuckDBPyConnection,
        selections: Sequence[Mapping[str, Any]],
        place: tuple[str, str],
        frame: int,
        track_id: str | None = None,
    ) -> None:
        """Make the table `checks` over the proposals of a frame and of a track.

        Each selection judges the rows that it read, as in `tcrdata.open`.

        Args:
            connection: of this drive; an earlier `checks` of it is replaced.
            selections: rows of `selections`.
            place: dataset and sequence.
            frame: whose proposals are judged.
            track_id: whose proposals are judged in all frames; None for no track.
        """
        parts = []
        (schema,) = connection.execute("select current_schema()").fetchall()[0]
        connection.execute("drop table if exists checks")
        for snapshot in sorted({row["snapshot"] for row in selections}):
            rows = [row for row in selections if row["snapshot"] == snapshot]
            read, judged = (
                self._reading(connection, rows[0], *place),
                f"judged_{next(self._numbers)}",
            )
            connection.execute(f"create schema {judged}")
            connection.execute(
                f"create table {judged}.proposals as "
                f"select * from {read}.proposals where frame = $1 or track_id = $2",
                [frame, track_id],
            )
            # The rest is that of the snapshot.
            connection.execute(f"set search_path = '{judged},{read}'")
            checks = checks_view_sql(rows, one_round=rows[0]["round"] == MEASURED)
            connection.execute(f"create table {judged}.checks as {checks}")
            connection.execute(f"set search_path = '{schema}'")
            parts.append(f"from {judged}.checks")
        connection.execute(f"create table checks as {' union all '.join(parts)}")

    def _reading(
        self,
        connection: duckdb.DuckDBPyConnection,
        selection: Mapping[str, Any],
        dataset: str,
        sequence: str,
    ) -> str:
        """The schema of the evidence of a drive that a selection read; made if it is not there."""
        asked = (selection["snapshot"], selection["round"], dataset, sequence)
        if asked not in self._schemas:
            schema = self._schemas[asked] = f"drive_{next(self._numbers)}"
            evidence = self._evidence(selection, dataset, sequence)
            create_views(connection, self._files, evidence, {}, schema, bundled=False)
        return self._schemas[asked]

    @cached_property
    def _database(self) -> duckdb.DuckDBPyConnection:
        """One for all drives, each in a schema of its own."""
        return connect(self._files, {}, {}, bundled=False)

    def _selections(self, dataset: str, sequence: str) -> list[dict[str, Any]]:
        schema = f"selections_{next(self._numbers)}"
        files = {"selections": self.store.files("selections", dataset=dataset, sequence=sequence)}
        create_views(self._database, self._files, files, {}, schema, bundled=False)
        return plain_rows(self._database.execute(f"from {schema}.selections"))

    def _snapshot(
        self, selection: Mapping[str, Any], drive: tuple[str, str] | None = None
    ) -> Snapshot:
        """What a selection read, or of it one drive's files: a store has thousands of drives."""
        asked = (selection["snapshot"], drive)
        if asked not in self._snapshots:
            self._snapshots[asked] = self.store.snapshot(*asked)
        return self._snapshots[asked]

    def _evidence(
        self, selection: Mapping[str, Any], dataset: str, sequence: str
    ) -> dict[str, list[FileEntry]]:
        """The files of one drive that a selection read, a list a table."""
        chosen: dict[str, list[FileEntry]] = {table: [] for table in EVIDENCE_TABLES}
        rounds = rounds_read(selection["round"])
        for entry in self._snapshot(selection, (dataset, sequence)).files:
            unit = entry.unit
            own = (unit.dataset, unit.sequence) == (dataset, sequence) and unit.round in rounds
            if entry.table in chosen and own:
                chosen[entry.table].append(entry)
        return chosen
