"""Rows to Parquet and back, deterministically.

Light tables: zstd 3. Heavy tables: one row a row group, nothing compressed, for their bytes
already are; so one row is read without its neighbours.
"""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tcrdata.errors import SchemaError, StoreError
from tcrdata.store.columns import array_of
from tcrdata.store.commits import FileEntry
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.schemas import arrow_schema, is_heavy, other_columns

ROWS_A_HEAVY_FILE = 512
ROWS_A_LIGHT_GROUP = 131072
_OPEN_FILES = 64


def parquet_writer(file: Any, table: str) -> pq.ParquetWriter:
    """A writer of one file of a table; equal rows give equal bytes."""
    schema = arrow_schema(table)
    if not is_heavy(table):
        return pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            compression_level=3,
            use_dictionary=repeated_columns(table),
        )
    return pq.ParquetWriter(
        file,
        schema,
        compression="none",
        use_dictionary=False,
        write_statistics=light_columns(table),
    )


def write_rows(writer: pq.ParquetWriter, table: str, rows: pa.Table) -> None:
    """Write rows with the table's row groups."""
    writer.write_table(rows, row_group_size=1 if is_heavy(table) else ROWS_A_LIGHT_GROUP)


def light_columns(table: str) -> list[str]:
    """Columns without dense arrays: what rows can be chosen by."""
    nested = (pa.types.is_binary, pa.types.is_struct, pa.types.is_list, pa.types.is_map)
    return [f.name for f in arrow_schema(table) if not any(test(f.type) for test in nested)]


def repeated_columns(table: str) -> list[str]:
    """Columns of a light table whose values come again and again, and so get a dictionary.

    Measured numbers and a row's own name do not: looking for repeats in them takes longer than
    the rest of the writing.
    """
    unique = ("proposal_id",)
    kinds = [(field.name, field.type) for field in arrow_schema(table) if field.name not in unique]
    return [
        f"{name}.list.element" if pa.types.is_list(kind) else name
        for name, kind in kinds
        if not pa.types.is_floating(kind)
        and not pa.types.is_map(kind)
        and not (pa.types.is_list(kind) and not pa.types.is_string(kind.value_type))
    ]


@contextmanager
def damage_errors(path: str) -> Iterator[None]:
    """Turn what pyarrow says of a torn file into a StoreError that names the file."""
    try:
        yield
    except (pa.ArrowException, OSError, EOFError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StoreError(
            f"{path} is damaged or missing ({reason}): restore it, or delete it and its "
            "sequence's commit records and build again"
        ) from error


class ParquetHandle:
    """An open file; where rows are chosen by their values it reads only their row groups."""

    def __init__(self, files: Filesystem, path: str, table: str) -> None:
        self.path = files.full_path(path)
        self._table = table
        self._lock = Lock()
        self._keys: pa.Table | None = None
        self._groups: dict[tuple[str, ...], dict[tuple[Any, ...], list[int]]] = {}
        with damage_errors(self.path):
            self._file = pq.ParquetFile(files.open(path), pre_buffer=not files.is_local)

    def read(self, columns: Sequence[str], equals: Mapping[str, Any]) -> pa.Table:
        """Rows with `column == value`, in file order, as the table's schema has them."""
        there = self._file.schema_arrow.names
        if absent := [name for name in columns if name not in there]:
            raise other_columns(self._table, self.path, f"no {absent[0]}")
        wanted_schema = pa.schema([arrow_schema(self._table).field(name) for name in columns])
        with self._lock, damage_errors(self.path):
            if is_heavy(self._table) and equals:
                groups = self._matching_groups(equals)
                if not groups:
                    return pa.Table.from_batches([], schema=wanted_schema)
                rows = self._file.read_row_groups(groups, list(columns))
            else:
                wanted = list(dict.fromkeys([*columns, *equals]))
                rows = self._file.read(wanted)
                if equals:
                    rows = _slices(
                        rows, _rows_by_values(rows, tuple(equals)).get(_key(rows, equals), [])
                    )
                rows = rows.select(list(columns))
        return rows if rows.schema == wanted_schema else rows.cast(wanted_schema)

    def _matching_groups(self, equals: Mapping[str, Any]) -> list[int]:
        """Numbers of the row groups that match: each holds one row, so they are the rows'."""
        if self._keys is None:
            self._keys = self._file.read(light_columns(self._table))
        names = tuple(equals)
        if names not in self._groups:
            self._groups[names] = _rows_by_values(self._keys, names)
        return self._groups[names].get(_key(self._keys, equals), [])


class ParquetHandles:
    """The files read last, kept open."""

    def __init__(self, files: Filesystem) -> None:
        self._files = files
        self._open: OrderedDict[str, ParquetHandle] = OrderedDict()
        self._lock = Lock()

    def get(self, path: str, table: str) -> ParquetHandle:
        """The handle of a file; StoreError when it is damaged or missing."""
        with self._lock:
            handle = self._open.pop(path, None) or ParquetHandle(self._files, path, table)
            self._open[path] = handle
            if len(self._open) > _OPEN_FILES:
                self._open.popitem(last=False)
            return handle

    def rows(
        self,
        table: str,
        entries: Sequence[FileEntry],
        columns: Sequence[str] | None,
        keys: Mapping[str, Any],
        equals: Mapping[str, Any],
    ) -> pa.Table:
        """Rows of some of a table's files, in file order.

        Args:
            table: the table.
            entries: the files.
            columns: those wanted; all when None.
            keys: values of `dataset`, `sequence` and `round`; compared where a file's unit differs.
            equals: further columns to their values.

        Raises:
            SchemaError: an unknown column, or a value of another type than its column.
            StoreError: a file is damaged; names it.
        """
        schema = arrow_schema(table)
        wanted = list(schema.names) if columns is None else list(columns)
        for name in (*wanted, *equals):
            if name not in schema.names:
                known = ", ".join(schema.names)
                raise SchemaError(f"table {table} has no column {name}: its columns are {known}")
        found = []
        for entry in entries:
            rest = {k: v for k, v in keys.items() if getattr(entry.unit, k) != v}
            rest = {name: value for name, value in rest.items() if name in schema.names}
            found.append(self.get(entry.path, table).read(wanted, {**rest, **equals}))
        chosen = pa.schema([schema.field(name) for name in wanted])
        if not found:
            return pa.Table.from_batches([], schema=chosen)
        return pa.concat_tables(found).replace_schema_metadata(chosen.metadata)


def _rows_by_values(rows: pa.Table, names: tuple[str, ...]) -> dict[tuple[Any, ...], list[int]]:
    """Return the numbers of the rows that have each combination of values of some columns."""
    found: defaultdict[tuple[Any, ...], list[int]] = defaultdict(list)
    for number, values in enumerate(zip(*(rows[name].to_pylist() for name in names), strict=True)):
        found[values].append(number)
    return found


def _key(rows: pa.Table, equals: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the values asked for, which their columns must be able to hold.

    Raises:
        SchemaError: a value's type does not fit its column.
    """
    for name, value in equals.items():
        kind = rows.schema.field(name).type
        if _plainly_holds(kind, value):
            continue
        try:
            if array_of(kind, [value]) is None:
                pa.scalar(value, type=kind)
        except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError) as error:
            raise SchemaError(f"column {name} cannot equal {value!r}: {error}") from error
    return tuple(equals.values())


def _plainly_holds(kind: pa.DataType, value: Any) -> bool:
    """Whether a column can surely hold a value: what nearly every look at a heavy row asks for."""
    if type(value) is str:
        return bool(pa.types.is_string(kind))
    return type(value) is int and bool(pa.types.is_int32(kind)) and 0 <= value < 2**31


def _slices(rows: pa.Table, numbers: list[int]) -> pa.Table:
    """Return some rows, given in rising order.

    Arrow's own filter imports its whole library of functions, which takes longer.
    """
    starts = [n for n, before in zip(numbers, [-2, *numbers], strict=False) if n != before + 1]
    ends = [n + 1 for n, after in zip(numbers, [*numbers[1:], -2], strict=False) if n + 1 != after]
    parts = [rows.slice(a, b - a) for a, b in zip(starts, ends, strict=True)]
    return pa.concat_tables([rows.slice(0, 0), *parts])
