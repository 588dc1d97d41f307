"""One drive of a store as a selection saw it, opened without a look at the other drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import duckdb

from tcrdata.rules import checks_view_sql
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.rounds import MEASURED, rounds_read
from tcrdata.store import FileEntry, Snapshot, Store
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.views import connect, create_views


class Drives:
    """The drives of a store as its selections saw them. Reads each snapshot once."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._files = Filesystem(store.url)
        self._snapshots: dict[tuple[str, tuple[str, str] | None], Snapshot] = {}

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
        connection = connect(self._files, tables, {}, bundled=False)
        labels = {"labels": self.store.files("labels", dataset=dataset, sequence=sequence)}
        create_views(connection, self._files, labels, {}, "of_any_drive", bundled=False)
        # Names of drives hold no quotes: the store allows letters, digits and few signs.
        own = f"dataset = '{dataset}' and sequence = '{sequence}'"
        views = {"labels": f"select * from of_any_drive.labels where {own}"}
        create_views(connection, self._files, {}, views, bundled=False)
        return connection

    def selections(self, dataset: str, sequence: str, round: int) -> list[dict[str, Any]]:
        """Return the rows of `selections` of a round, found through one drive's records."""
        rows = self.store.read("selections", dataset=dataset, sequence=sequence).to_pylist()
        return [row for row in rows if row["round"] == round]

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
        for number, snapshot in enumerate(sorted({row["snapshot"] for row in selections})):
            rows = [row for row in selections if row["snapshot"] == snapshot]
            evidence = self._evidence(rows[0], *place)
            read, judged = f"read_{number}", f"judged_{number}"
            for schema in (judged, read):
                connection.execute(f"drop schema if exists {schema} cascade")
            create_views(connection, self._files, evidence, {}, read, bundled=False)
            connection.execute(f"create schema {judged}")
            connection.execute(
                f"create table {judged}.proposals as "
                f"select * from {read}.proposals where frame = $1 or track_id = $2",
                [frame, track_id],
            )
            others = [table for table in evidence if table != "proposals"]
            views = {table: f"from {read}.{table}" for table in others}
            one_round = rows[0]["round"] == MEASURED
            views["checks"] = checks_view_sql(rows, one_round=one_round)
            create_views(connection, self._files, {}, views, judged, bundled=False)
            parts.append(f"from {judged}.checks")
        connection.execute(f"create or replace table checks as {' union all '.join(parts)}")

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
