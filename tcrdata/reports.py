"""Runs the files of `queries/reports/` as they stand, with other values for their variables."""

from __future__ import annotations

from collections.abc import Mapping
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
    import duckdb

    path = resource_folder("queries") / folder / f"{name}.sql"
    *setters, select = connection.extract_statements(path.read_text(encoding="utf-8"))
    for setter in setters:
        connection.execute(setter)
    known = variables(connection)
    for parameter, value in (parameters or {}).items():
        if parameter not in known:
            raise SettingsError(
                f"{path.name} has no parameter '{parameter}': it has {', '.join(known)}"
            )
        if value is not None:
            connection.execute(f"set variable {parameter} = ?", [value])
    try:
        return connection.sql(select.query)
    except duckdb.Error as error:
        line = str(error).splitlines()[0]
        raise QueryError(f"{path}: {line}: restore the file or correct its SQL") from error


def variables(connection: duckdb.DuckDBPyConnection) -> dict[str, str]:
    """Return the variables that are set on a connection, as text, sorted by name."""
    rows = connection.execute("select name, value from duckdb_variables() order by name")
    return dict(rows.fetchall())
