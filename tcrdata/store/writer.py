"""One unit's rows on their way into the store: streamed, then visible all at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from tcrdata.errors import ConflictError, StoreError
from tcrdata.store.commits import CommitRecord, FileEntry, Unit, dump_json, parse_json
from tcrdata.store.filesystem import Filesystem, HashingFile, Staging, storage_errors
from tcrdata.store.parquet import ROWS_A_HEAVY_FILE, ROWS_A_LIGHT_GROUP, parquet_writer, write_rows
from tcrdata.store.rows import to_rows
from tcrdata.store.schemas import is_heavy


class Writer:
    """Collects a unit's rows; `Store.writer` opens it and commits at the end of the block.

    Rows go to growing files, light ones a row group and heavy ones a row at a time, so that memory
    stays small on the local disk.
    """

    def __init__(self, files: Filesystem, staging: Staging, unit: Unit) -> None:
        self.unit = unit
        self._files = files
        self._staging = staging
        self._light: dict[str, list[pa.Table]] = {}
        self._growing: dict[str, _GrowingFile] = {}
        self._finished: list[tuple[FileEntry, BinaryIO]] = []
        self._rows: dict[str, int] = {}
        self._failed: list[tuple[int, str]] = []

    def append(self, table: str, columns: Mapping[str, Any]) -> None:
        """Add rows.

        Args:
            table: a table of `schemas/`.
            columns: name to list or array, all of one length; an array of more than one dimension
                is one row-major list a row. Missing columns become NULL; NaN becomes NULL;
                `dataset`, `sequence` and `round` are the unit's. No columns at all: the table is
                recorded with no rows.

        Raises:
            SchemaError: the rows do not fit the table; names table and column.
            StoreError: the disk is full.
        """
        rows = to_rows(table, columns, self.unit)
        self._rows[table] = self._rows.get(table, 0) + rows.num_rows
        if not is_heavy(table):
            self._buffer(table, rows)
            return
        rows = rows.combine_chunks()
        while rows.num_rows:
            growing = self._growing.get(table) or self._grow(table)
            room = ROWS_A_HEAVY_FILE - growing.rows
            growing.write(rows.slice(0, room))
            rows = rows.slice(room)
            if growing.rows == ROWS_A_HEAVY_FILE:
                self._finish(self._growing.pop(table))

    def _buffer(self, table: str, rows: pa.Table) -> None:
        """Keep light rows until they fill a row group: files are cut the same however they come."""
        waiting = self._light.setdefault(table, [])
        waiting.append(rows)
        if sum(part.num_rows for part in waiting) < ROWS_A_LIGHT_GROUP:
            return
        gathered = pa.concat_tables(waiting)
        growing = self._growing.get(table) or self._grow(table)
        whole = gathered.num_rows - gathered.num_rows % ROWS_A_LIGHT_GROUP
        # Pages are cut where chunks are: each row is copied, once, into whole row groups.
        growing.write(gathered.slice(0, whole).combine_chunks())
        self._light[table] = [gathered.slice(whole)]

    def error(self, frame: int, message: str) -> None:
        """Keep in the record that a frame could not be done, and why."""
        self._failed.append((int(frame), " ".join(str(message).split())))

    def commit(self, generation: int, settings_hash: str, inputs: Mapping[str, str]) -> None:
        """Publish the files, then the record, exclusively.

        Raises:
            ConflictError: another content is already there under this generation.
            StoreError: the disk is full, or a file of the same name is damaged.
        """
        for table in sorted(self._light):
            growing = self._growing.get(table) or self._grow(table)
            last = pa.concat_tables(self._light[table]).combine_chunks()
            if last.num_rows or not growing.rows:
                growing.write(last)
            self._finish(self._growing.pop(table))
        for table in sorted(self._growing):
            self._finish(self._growing.pop(table))
        self._finished.sort(key=lambda pair: pair[0].table)
        for entry, file in self._finished:
            self._publish(entry, file)
        self._record(
            CommitRecord(
                unit=self.unit,
                generation=generation,
                settings_hash=settings_hash,
                inputs=dict(inputs),
                tables=self._rows,
                files=tuple(entry for entry, _ in self._finished),
                failed_frames=tuple(sorted(self._failed)),
            )
        )

    def abandon(self) -> None:
        """Close what is open; its staging removes it."""
        for growing in self._growing.values():
            growing.abandon()
        for _, file in self._finished:
            file.close()

    def _grow(self, table: str) -> _GrowingFile:
        growing = _GrowingFile(table, self._staging.open())
        self._growing[table] = growing
        return growing

    def _finish(self, growing: _GrowingFile) -> None:
        """Close a file; it is named by its content. Without rows there is none."""
        sha256, size = growing.finish()
        if not growing.rows:
            growing.file.close()
            return
        unit = self.unit
        name = f"r{unit.round}-{sha256[:16]}.parquet"
        path = f"data/{growing.table}/{unit.dataset}/{unit.sequence}/{name}"
        entry = FileEntry(growing.table, path, growing.rows, size, sha256, unit)
        self._finished.append((entry, growing.file))

    def _publish(self, entry: FileEntry, file: BinaryIO) -> None:
        if self._staging.publish(file, entry.path):
            return
        if self._files.size(entry.path) != entry.bytes:
            raise StoreError(
                f"{self._files.full_path(entry.path)} is damaged: delete it and run again"
            )

    def _record(self, record: CommitRecord) -> None:
        path = self.unit.record_path(record.generation)
        data = dump_json(record.to_json())
        if self._files.create(path, data):
            return
        there = parse_json(path, self._files.read(path), "commit record", CommitRecord.from_json)
        if there == record:
            return
        theirs, ours = there.to_json(), record.to_json()
        different = ", ".join(part for part in ours if ours[part] != theirs[part])
        raise ConflictError(
            f"{path}: another writer has committed other rows for {self.unit}, generation "
            f"{record.generation}: they differ in {different}. Nothing was changed: "
            "run again to build on what is there"
        )


class _GrowingFile:
    """A Parquet file that is being written."""

    def __init__(self, table: str, file: BinaryIO) -> None:
        self.table = table
        self.file = file
        self.rows = 0
        self._hashing = HashingFile(file)
        with storage_errors(f"table {table}"):
            self._writer: pq.ParquetWriter = parquet_writer(self._hashing, table)

    def write(self, rows: pa.Table) -> None:
        with storage_errors(f"table {self.table}"):
            write_rows(self._writer, self.table, rows)
        self.rows += rows.num_rows

    def finish(self) -> tuple[str, int]:
        """sha256 and size of the whole file."""
        with storage_errors(f"table {self.table}"):
            self._writer.close()
            self.file.flush()
        return self._hashing.sha256, self._hashing.size

    def abandon(self) -> None:
        self._hashing.abandon()
        self._writer.close()
