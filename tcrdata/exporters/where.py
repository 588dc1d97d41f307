"""The user's own condition on labels: checked, and run where it can write nothing."""

from __future__ import annotations

import json
from typing import Any

import duckdb

from tcrdata.errors import QueryError
from tcrdata.store.bundles import COMPACTED
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.schemas import is_view, table_names
from tcrdata.store.views import no_glob

_TRUTH = ("ground_truth", "truth_tracklets", "metrics")
_PLACES = ("query_location", "query_location_length")


def keep(connection: duckdb.DuckDBPyConnection, selection_id: str, condition: str) -> None:
    """Make `chosen.labels`: a selection's labels that fulfil a condition.

    DuckDB's own parser must read `select * from labels where (<condition>)` as exactly that query:
    nothing after the condition, no second statement, nothing that writes.

    Args:
        connection: has `labels`; locked by `lock`, so that no function reaches other files.
        selection_id: whose labels.
        condition: SQL; true or false for each label.

    Raises:
        QueryError: it is no such condition, or does not run; says why in one line.
    """
    if not condition.strip():
        raise QueryError("--where is empty: give a condition such as --where 'score > 0.9'")
    if statement := _statement(connection, condition):
        raise QueryError(
            f"--where '{condition}' is a statement ({statement}): give only what must hold for a "
            "label, such as --where 'score > 0.9'"
        )
    if _around(_tree(connection, condition)) != _around(_tree(connection, "true")):
        raise QueryError(
            f"--where '{condition}' is more than one condition on a label: "
            "leave what follows the condition away (union, order by, limit ...)"
        )
    try:
        (kind,) = connection.sql(f"select (\n{condition}\n) from labels").types
        chosen = connection.sql(f"select * from labels where (\n{condition}\n)")
        if str(kind) == "BOOLEAN":
            connection.execute("create schema chosen")
            name = duckdb.ConstantExpression(selection_id)
            chosen.filter(duckdb.ColumnExpression("selection_id") == name).create("chosen.labels")
    except duckdb.Error as error:
        raise _refused(condition, str(error)) from error
    if str(kind) != "BOOLEAN":
        raise QueryError(
            f"--where '{condition}' is {str(kind).lower()}, not true or false: "
            "compare it with something"
        )


def readable_tables() -> list[str]:
    """Tables that a condition may read: all but what evaluation alone reads, and views."""
    return [name for name in table_names() if not is_view(name) and name not in _TRUTH]


def lock(connection: duckdb.DuckDBPyConnection, url: str) -> None:
    """Let a connection read the files of a store's readable tables and nothing else, for good."""
    files = Filesystem(url)
    above = ("data", COMPACTED) if files.is_local else ()
    folders = [files.full_path(f"{a}/{table}/") for a in above for table in readable_tables()]
    # DuckDB asks for the name it was given, and again for the file that it found.
    allowed = sorted({*folders, *map(no_glob, folders)})
    connection.execute("set allowed_directories = $folders", {"folders": allowed})
    connection.execute("set enable_external_access = false")
    connection.execute("set lock_configuration = true")


def _statement(connection: duckdb.DuckDBPyConnection, condition: str) -> str | None:
    """Return what kind of statement a text is by itself; None when it is none, as it should be."""
    try:
        found = connection.extract_statements(condition)
    except duckdb.ParserException:
        return None
    return found[0].type.name.lower() if found else None


def _tree(connection: duckdb.DuckDBPyConnection, condition: str) -> dict[str, Any]:
    """Return the parsed query with the condition in it."""
    rows = connection.execute(
        "select json_serialize_sql(?)", [f"select * from labels where (\n{condition}\n)"]
    )
    tree: dict[str, Any] = json.loads(rows.fetchall()[0][0])
    if tree["error"]:
        raise _refused(condition, tree["error_message"])
    return tree


def _around(tree: dict[str, Any]) -> Any:
    """Return a parsed query without its condition."""
    nodes = [dict(statement["node"]) for statement in tree["statements"]]
    return _without_places([{**node, "where_clause": None} for node in nodes])


def _without_places(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_places(v) for k, v in value.items() if k not in _PLACES}
    if isinstance(value, list):
        return [_without_places(item) for item in value]
    return value


def _refused(condition: str, reason: str) -> QueryError:
    first = reason.strip().splitlines()[0]
    return QueryError(
        f"--where '{condition}' is no condition on labels: {first}; "
        'it may use the columns of labels: see `tcrdata sql "describe labels"`'
    )
