"""Tables as DuckDB views and polars frames over explicit lists of files: no globs, no guessing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from tcrdata.errors import QueryError, StoreError
from tcrdata.store.bundles import read_bundles, stand_ins
from tcrdata.store.commits import FileEntry
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.schemas import arrow_schema, columns, ddl, is_view, other_columns

if TYPE_CHECKING:
    import duckdb
    import polars
    import pyarrow.dataset


def connect(
    files: Filesystem,
    tables: Mapping[str, Sequence[FileEntry]],
    views: Mapping[str, str],
    *,
    bundled: bool = True,
) -> duckdb.DuckDBPyConnection:
    """A DuckDB connection in memory with one view a table, then the extra views.

    Args:
        files: of the store.
        tables: table to its files.
        views: name to SQL.
        bundled: read bundles in the place of the files that they hold.

    Raises:
        StoreError: a file that a view reads first is damaged.
        QueryError: an extra view's SQL does not bind.
    """
    import duckdb

    connection = duckdb.connect()
    # Files never change: their footers need reading once a connection, not once a query.
    connection.execute("set global parquet_metadata_cache = true")
    create_views(connection, files, tables, views, bundled=bundled)
    return connection


def create_views(
    connection: duckdb.DuckDBPyConnection,
    files: Filesystem,
    tables: Mapping[str, Sequence[FileEntry]],
    views: Mapping[str, str],
    schema: str = "main",
    *,
    bundled: bool = True,
) -> None:
    """Create the views of `connect` in one of the connection's schemas.

    Unqualified names in a view's SQL mean the views of the same schema.
    """
    import duckdb

    connection.execute(f"create schema if not exists {quote(schema)}")
    bundles = read_bundles(files) if bundled else []
    for table, entries in tables.items():
        if table not in views:
            _create_table(connection, files, table, stand_ins(bundles, entries), schema)
    for name, sql in views.items():
        try:
            connection.execute(f"create or replace view {quote(schema)}.{quote(name)} as {sql}")
        except duckdb.Error as error:
            raise QueryError(f"the view {name} does not bind: {one_line(error)}") from error


def _create_table(
    connection: duckdb.DuckDBPyConnection,
    files: Filesystem,
    table: str,
    entries: Sequence[FileEntry],
    schema: str,
) -> None:
    """One view over the files; without files the empty table of the schema."""
    import duckdb

    target = f"{quote(schema)}.{quote(table)}"
    if not entries or is_view(table):
        connection.execute(ddl(table).replace(f"create table {table}", f"create table {target}", 1))
        return
    names = ", ".join(quote(column.name) for column in columns(table))
    if files.is_local:
        _check_sizes(files, entries)
        root = no_glob(files.full_path("")).replace("'", "''")
        paths = ", ".join(f"'{root}{entry.path}'" for entry in entries)
        source = f"read_parquet([{paths}], hive_partitioning = false)"
    else:
        source = quote(f"_{schema}_{table}")
        connection.register(source.strip('"'), arrow_dataset(files, table, entries))
    try:
        connection.execute(f"create view {target} as select {names} from {source}")
    except duckdb.BinderException as error:
        raise other_columns(table, files.url, one_line(error)) from error
    except duckdb.Error as error:
        raise StoreError(f"table {table} cannot be read: {one_line(error)}") from error


def _check_sizes(files: Filesystem, entries: Sequence[FileEntry]) -> None:
    """A torn file is named now, not in the middle of a query."""
    for entry in entries:
        if files.size(entry.path) != entry.bytes:
            raise StoreError(
                f"{files.full_path(entry.path)} is damaged or missing: restore it, or delete it "
                "and its sequence's commit records and build again"
            )


def arrow_dataset(
    files: Filesystem, table: str, entries: Sequence[FileEntry]
) -> pyarrow.dataset.Dataset:
    """The files as a pyarrow dataset: read lazily, columns and rows pushed down."""
    # Imports pandas, for which no command over a local folder should wait.
    import pyarrow.dataset

    return pyarrow.dataset.dataset(
        [files.full_path(entry.path) for entry in entries],
        schema=arrow_schema(table),
        format="parquet",
        filesystem=files.arrow(),
    )


def lazy_frame(files: Filesystem, table: str, entries: Sequence[FileEntry]) -> polars.LazyFrame:
    """The files as a polars LazyFrame; without files an empty one with the table's types."""
    import polars

    if not entries:
        empty = polars.from_arrow(arrow_schema(table).empty_table())
        assert isinstance(empty, polars.DataFrame)
        return empty.lazy()
    if files.is_local:
        _check_sizes(files, entries)
        paths = [files.full_path(entry.path) for entry in entries]
        return polars.scan_parquet(paths, glob=False, hive_partitioning=False)
    return polars.scan_pyarrow_dataset(arrow_dataset(files, table, entries))


def quote(name: str) -> str:
    """A name as an SQL identifier."""
    return '"' + name.replace('"', '""') + '"'


def one_line(error: Exception) -> str:
    """The first line of a message, without what DuckDB draws below it."""
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def query_error(error: Exception) -> QueryError:
    """Return the error of a query of the user's: what is wrong, in which line, what to do."""
    message, _, place = str(error).partition("\n\nLINE ")
    number = place.partition(":")[0]
    where = f" (line {number} of the query)" if number.isdigit() else ""
    said = " ".join(message.split())
    return QueryError(f"{said}{where}; mend it: `show tables` and `describe TABLE` list the names")


def no_glob(path: str) -> str:
    """A path as a pattern that means it alone: DuckDB takes every path for a pattern."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in path)
