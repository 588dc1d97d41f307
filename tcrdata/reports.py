"""Runs the files of `queries/reports/` as they stand, with other values for their variables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcrdata.errors import QueryError, SettingsError
from tcrdata.resources import resource_folder

if TYPE_CHECKING:
    import duckdb


def run_report(
    connection: duckdb.DuckDBPyConnection,
    name: str,
    parameters: Mapping[str, Any] | None = None,
    folder: str = "reports",
) -> duckdb.DuckDBPyRelation:
    """Run the `set variable` lines of `queries/<folder>/<name>.sql`, then its select.

    Args:
        connection: has the tables of a store as views; keeps the variables afterwards.
        name: the file's, without its ending.
        parameters: values that replace the file's own; None leaves the file's.
        folder: of `queries/` that holds the file.

    Raises:
        SettingsError: the file sets no variable of that name.
        QueryError: the select does not run; names the file.
    """
    path, select = _made_ready(connection, name, parameters, folder)
    with _query_errors(path):
        return connection.sql(select)


def check_report(name: str, parameters: Mapping[str, Any], folder: str = "reports") -> None:
    """Check that a report sets variables of these names, before anything else is done.

    Raises:
        SettingsError: it does not.
    """
    import duckdb

    connection = duckdb.connect()
    try:
        _made_ready(connection, name, parameters, folder)
    finally:
        connection.close()


def report_rows(
    connection: duckdb.DuckDBPyConnection, name: str, parameters: Mapping[str, Any] | None = None
) -> list[dict[str, Any]]:
    """Run a report and return its rows by column name; see `run_report`.

    A relation would bind the select twice: to say its columns, and to run it.
    """
    path, select = _made_ready(connection, name, parameters, "reports")
    with _query_errors(path):
        return plain_rows(connection.execute(select))


def plain_rows(result: duckdb.DuckDBPyConnection) -> list[dict[str, Any]]:
    """Return the rows of what a connection has just executed, by column name."""
    names = [column[0] for column in result.description or ()]
    return [dict(zip(names, row, strict=True)) for row in result.fetchall()]


def _made_ready(
    connection: duckdb.DuckDBPyConnection,
    name: str,
    parameters: Mapping[str, Any] | None,
    folder: str,
) -> tuple[Path, str]:
    """Set the variables of a file; return its path and its select."""
    path = resource_folder("queries") / folder / f"{name}.sql"
    *setters, select = connection.extract_statements(path.read_text(encoding="utf-8"))
    for setter in setters:
        connection.execute(setter)
    known = variables(connection) if parameters else {}
    for parameter, value in (parameters or {}).items():
        if parameter not in known:
            raise SettingsError(
                f"{path.name} has no parameter '{parameter}': it has {', '.join(known)}"
            )
        if value is not None:
            connection.execute(f"set variable {parameter} = ?", [value])
    return path, select.query


@contextmanager
def _query_errors(path: Path) -> Iterator[None]:
    import duckdb

    try:
        yield
    except duckdb.Error as error:
        line = str(error).splitlines()[0]
        raise QueryError(f"{path}: {line}: restore the file or correct its SQL") from error


def variables(connection: duckdb.DuckDBPyConnection) -> dict[str, str]:
    """Return the variables that are set on a connection, as text, sorted by name."""
    rows = connection.execute("select name, value from duckdb_variables() order by name")
    return dict(rows.fetchall())
