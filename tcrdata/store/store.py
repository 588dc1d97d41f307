"""The store: units in, tables out. Nothing is overwritten; no clock, no server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tcrdata.errors import StoreError
from tcrdata.store import snapshots
from tcrdata.store.bundles import Bundle
from tcrdata.store.commits import CommitRecord, FileEntry, Unit
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.history import History
from tcrdata.store.schemas import check_known, is_view, table_names
from tcrdata.store.sequence_tables import SequenceTables
from tcrdata.store.snapshots import Ids, Snapshot
from tcrdata.store.views import connect, create_views, lazy_frame

if TYPE_CHECKING:
    import duckdb
    import polars
    import pyarrow as pa

    from tcrdata.store.parquet import ParquetHandles
    from tcrdata.store.writer import Writer

_FOLD_FROM = 256


class Store:
    """Tables of immutable files, made visible by commit records. Pickles as its URL."""

    def __init__(self, files: Filesystem, pinned: str | None = None) -> None:
        self._files = files
        self._history = History(files)
        self._pinned = pinned

    @cached_property
    def _handles(self) -> ParquetHandles:
        # Commands that only ask, and ask DuckDB, do without the import of Arrow.
        from tcrdata.store.parquet import ParquetHandles

        return ParquetHandles(self._files)

    def __reduce__(self) -> tuple[type[Store], tuple[Filesystem, str | None]]:
        return Store, (self._files, self._pinned)

    def at(self, snapshot: str) -> Store:
        """The same store for reading, its tables and newest selection as a snapshot has them.

        Raises:
            StoreError: there is no such snapshot.
        """
        return Store(self._files, self.snapshot(snapshot).name)

    @property
    def url(self) -> str:
        """Where the store lies."""
        return self._files.url

    def record(self, unit: Unit) -> CommitRecord | None:
        """The newest record of a unit; None when it is not done."""
        return self._history.newest(unit)

    def records(self) -> list[CommitRecord]:
        """The newest record of every unit, sorted by dataset, sequence, round and stage."""
        return self._history.all_newest()

    def sequence_records(self, dataset: str, sequence: str) -> list[CommitRecord]:
        """The newest record of every unit of one sequence."""
        records = self._history.newest_of(dataset, sequence)
        return [record for record in records if record.unit.dataset == dataset]

    def is_done(self, unit: Unit, settings_hash: str, inputs: Mapping[str, str]) -> bool:
        """Whether the newest record of a unit was made with these settings and inputs."""
        record = self.record(unit)
        return record is not None and record.matches(settings_hash, inputs)

    def checkpoint(self, least: int = _FOLD_FROM) -> bool:
        """Fold the records into one file, so that readers make few requests.

        Does nothing while fewer than `least` records are in no checkpoint. Call it at the end of
        a build: then the same build leaves the same files, however often it was interrupted.
        """
        return self._history.checkpoint(least)

    def compact(self) -> list[Bundle]:
        """Write the small files of light tables once more in few, which queries then read.

        Rows, records and snapshots stay as they are.
        """
        from tcrdata.store.compaction import compact

        return compact(self._files, self._entries(None, None))

    @contextmanager
    def writer(
        self, unit: Unit, *, settings_hash: str, inputs: Mapping[str, str]
    ) -> Iterator[Writer]:
        """Open a unit for writing; it is committed when the block ends without an exception.

        A redo with other settings or inputs than the newest record's takes the next generation.

        Raises:
            ConflictError: another writer committed other content meanwhile.
            SchemaError: rows do not fit a table.
            StoreError: the disk is full.
        """
        from tcrdata.store.writer import Writer

        last = self.record(unit)
        generation = 1
        if last is not None:
            generation = last.generation + (not last.matches(settings_hash, inputs))
        with self._files.staging() as staging:
            writer = Writer(self._files, staging, unit)
            try:
                yield writer
                writer.commit(generation, settings_hash, inputs)
            finally:
                writer.abandon()

    def files(
        self,
        table: str,
        *,
        snapshot: str | None = None,
        dataset: str | None = None,
        sequence: str | None = None,
        round: int | None = None,
    ) -> list[FileEntry]:
        """The files of a table, by dataset, sequence, round and stage, narrowed by the keys given.

        Files of selections (dataset `_`) hold rows of any sequence, so they are always listed.

        Raises:
            SchemaError: there is no such table.
            StoreError: the snapshot is unknown or does not cover the table.
        """
        moment = snapshot is None and self._pinned is None
        if moment and dataset is not None and sequence is not None:
            check_known(table)
            records = self._history.newest_of(dataset, sequence)
            entries = [e for record in records for e in record.files if e.table == table]
        else:
            entries = self._entries([table], snapshot)[table]
        return [entry for entry in entries if entry.unit.may_hold(dataset, sequence, round)]

    def read(
        self,
        table: str,
        *,
        columns: Sequence[str] | None = None,
        dataset: str | None = None,
        sequence: str | None = None,
        round: int | None = None,
        snapshot: str | None = None,
        **equals: Any,
    ) -> pa.Table:
        """Rows of a table, in file order.

        Of heavy tables only the rows that match are read; light ones are filtered once read.

        Args:
            table: a table of `schemas/`.
            columns: those wanted; all when None.
            dataset: rows of this dataset.
            sequence: rows of this sequence.
            round: rows of this round.
            snapshot: read its files instead of the newest.
            **equals: further `column == value`.

        Raises:
            SchemaError: an unknown table or column, or a value of another type than its column.
            StoreError: a file is damaged; names it.
        """
        keys = {"dataset": dataset, "sequence": sequence, "round": round}
        given = {name: value for name, value in keys.items() if value is not None}
        entries = self.files(
            table, snapshot=snapshot, dataset=dataset, sequence=sequence, round=round
        )
        return self.read_files(table, entries, columns, given, equals)

    def read_files(
        self,
        table: str,
        entries: Sequence[FileEntry],
        columns: Sequence[str] | None,
        keys: Mapping[str, Any],
        equals: Mapping[str, Any],
    ) -> pa.Table:
        """Rows of some of a table's files whose keys and columns equal the values; see `read`."""
        return self._handles.rows(table, entries, columns, keys, equals)

    def tables(self, dataset: str, sequence: str, round: int) -> SequenceTables:
        """The tables of one sequence and round, as cues get them."""
        return SequenceTables(self, dataset, sequence, round)

    def connect(
        self,
        *,
        snapshot: str | None = None,
        tables: Sequence[str] | None = None,
        views: Mapping[str, str] | None = None,
    ) -> duckdb.DuckDBPyConnection:
        """A DuckDB connection with one view a table over the files of this moment.

        Args:
            snapshot: its files instead of the newest; only the tables it covers.
            tables: only these.
            views: name to SQL of further views, made after the tables; one of a table's name
                takes its place. Without one for `checks` that is an empty table.

        Raises:
            StoreError: a file is damaged, or the snapshot does not cover a table.
            QueryError: the SQL of a view does not bind.
        """
        return connect(self._files, self._entries(tables, snapshot), views or {})

    def add_snapshot(
        self,
        connection: duckdb.DuckDBPyConnection,
        snapshot: str,
        schema: str,
        views: Mapping[str, str] | None = None,
        *,
        tables: Sequence[str] | None = None,
    ) -> None:
        """Add a snapshot's tables to a connection under a schema, with views that read them.

        Args:
            connection: of `connect`.
            snapshot: its name.
            schema: made when it is not there.
            views: as in `connect`.
            tables: only these; all that the snapshot covers when None.

        Raises:
            StoreError: the snapshot is unknown, does not cover a table, or a file is damaged.
            QueryError: the SQL of a view does not bind.
        """
        entries = self._entries(tables, snapshot)
        create_views(connection, self._files, entries, views or {}, schema)

    def scan(self, table: str, *, snapshot: str | None = None) -> polars.LazyFrame:
        """A table as a polars LazyFrame over the files of this moment."""
        return lazy_frame(self._files, table, self.files(table, snapshot=snapshot))

    def freeze(
        self,
        name: str | None = None,
        tables: Sequence[str] | None = None,
        files: Sequence[FileEntry] | None = None,
    ) -> Snapshot:
        """Freeze the files of this moment, or those given; without a name the content names it.

        Raises:
            ConflictError: the name is taken by another list of files.
        """
        chosen = [t for t in table_names() if not is_view(t)] if tables is None else list(tables)
        flat = self.files_of(chosen) if files is None else files
        return snapshots.freeze(self._files, name, chosen, flat)

    def files_of(
        self, tables: Iterable[str], records: Sequence[CommitRecord] | None = None
    ) -> list[FileEntry]:
        """The files of several tables at this moment, or of these records, table by table."""
        entries = self._entries(sorted(tables), None, records)
        return [entry for table in sorted(entries) for entry in entries[table]]

    def snapshot(self, name: str, drive: tuple[str, str] | None = None) -> Snapshot:
        """Read a snapshot, or its files of one dataset and sequence.

        Raises:
            StoreError: there is none of that name.
        """
        return snapshots.read_snapshot(self._files, name, drive)

    def snapshots(self) -> list[str]:
        """Names of all snapshots, sorted."""
        return snapshots.snapshot_names(self._files)

    def point_to(self, selection_id: str, name: str) -> None:
        """Make a selection the newest one; nothing is written when it already is."""
        snapshots.point_to(self._files, selection_id, name)

    def newest_selection(self, name: str | None = None, among: Ids = None) -> str | None:
        """Id of the newest selection (`among` some), or of that which a name or an id means.

        Raises:
            StoreError: the beginning of an id (6 characters or more) fits several.
        """
        if self._pinned is not None:
            there = {entry.unit.sequence for entry in self.files("selections")}
            among = there if among is None else there.intersection(among)
        return snapshots.newest_selection(self._files, name, among)

    def _entries(
        self,
        tables: Sequence[str] | None,
        snapshot: str | None,
        records: Sequence[CommitRecord] | None = None,
    ) -> dict[str, list[FileEntry]]:
        """The files of each table."""
        snapshot = snapshot or self._pinned
        if snapshot is None:
            chosen = table_names() if tables is None else tables
            records = self.records() if records is None else records
            found = [entry for record in records for entry in record.files]
        else:
            frozen = self.snapshot(snapshot)
            chosen = frozen.tables if tables is None else tables
            found = list(frozen.files)
            if missing := sorted(set(chosen) - set(frozen.tables)):
                raise StoreError(f"the snapshot {snapshot} does not cover table {missing[0]}")
        entries: dict[str, list[FileEntry]] = {table: [] for table in chosen}
        for table in chosen:
            check_known(table)
        for entry in found:
            if entry.table in entries:
                entries[entry.table].append(entry)
        return entries
