"""The tables of the store, read from `schemas/*.sql`: names, columns, Arrow types, weight."""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from tcrdata.errors import SchemaError
from tcrdata.resources import resource_files

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA_VERSION = 3
"""Version of all tables together; a store made with another one is refused."""

_WEIGHT = "-- weight:"
_COLUMN = re.compile(r" +(\w+) (.+?)( not null)?,? *(?:-- *(.*))?")
# Names of Arrow's own functions.
_SCALARS = {
    "varchar": "string",
    "blob": "binary",
    "boolean": "bool_",
    "integer": "int32",
    "bigint": "int64",
    "double": "float64",
}
# What the `datasets` library looks for to load a struct of bytes and path as an image.
_HUGGING_FACE_IMAGE = (
    b'{"info": {"features": {"dataset": {"dtype": "string", "_type": "Value"}, '
    b'"sequence": {"dtype": "string", "_type": "Value"}, '
    b'"frame": {"dtype": "int32", "_type": "Value"}, '
    b'"round": {"dtype": "int32", "_type": "Value"}, "image": {"_type": "Image"}}}}'
)


class Column(NamedTuple):
    """A column of a table: its name, its SQL type, and its comment (meaning, unit, frame)."""

    name: str
    type: str
    comment: str


class _Table(NamedTuple):
    ddl: str
    weight: str
    columns: list[Column]
    required: frozenset[str]


def table_names() -> list[str]:
    """Names of all tables, sorted; `checks`, which is a view, among them."""
    return list(_tables())


def arrow_schema(table: str) -> pa.Schema:
    """The Arrow schema of a table; columns declared `not null` are not nullable.

    Raises:
        SchemaError: there is no such table.
    """
    _table(table)
    return _arrow_schemas()[table]


def check_known(table: str) -> None:
    """Refuse a table that there is not.

    Raises:
        SchemaError: there is no such table.
    """
    _table(table)


def is_heavy(table: str) -> bool:
    """Whether a table keeps one row a row group, because its rows carry dense arrays."""
    return _table(table).weight == "heavy"


def is_view(table: str) -> bool:
    """Whether a table is worked out when it is asked for and never written."""
    return _table(table).weight == "view"


def ddl(table: str) -> str:
    """The text of the table's file in `schemas/`."""
    return _table(table).ddl


def columns(table: str) -> list[Column]:
    """Name, SQL type and comment of each column, in order."""
    return _table(table).columns


def fingerprints() -> dict[str, str]:
    """A hash of the columns of each table that is written: names, types, which may be NULL.

    Order, comments and metadata do not count, for rows are read by the names of their columns.
    """
    return {
        name: _fingerprint(table) for name, table in _tables().items() if table.weight != "view"
    }


def other_columns(table: str, where: str, reason: str) -> SchemaError:
    """The error of a file that lacks columns of its table.

    Args:
        table: whose rows the file holds.
        where: file or store.
        reason: what it lacks.
    """
    return SchemaError(
        f"table {table} in {where} has other columns than this tcrdata reads ({reason}): "
        "build into a new store, or use the tcrdata that made it"
    )


def _table(name: str) -> _Table:
    try:
        return _tables()[name]
    except KeyError:
        known = ", ".join(_tables())
        raise SchemaError(f"there is no table '{name}': the tables are {known}") from None


@lru_cache(maxsize=1)
def _tables() -> dict[str, _Table]:
    return {
        path.stem: _described(path.read_text(encoding="utf-8"))
        for path in resource_files("schemas/*.sql")
    }


def _described(text: str) -> _Table:
    """Read a table's file: one column a line, as a test compares with what DuckDB reads.

    DuckDB itself takes a tenth of a second for all, for which every command would wait.
    """
    lines = [_COLUMN.fullmatch(line) for line in text.splitlines()]
    parts = [found.groups(default="") for found in lines if found]
    found = [Column(column, kind, comment) for column, kind, _, comment in parts]
    required = frozenset(column for column, _, not_null, _ in parts if not_null)
    return _Table(text, _weight(text), found, required)


@lru_cache(maxsize=1)
def _arrow_schemas() -> dict[str, pa.Schema]:
    """All schemas; apart, for commands that only ask do without the import of Arrow."""
    import pyarrow as pa

    return {
        name: pa.schema(
            [
                pa.field(column, _arrow_type(kind), nullable=column not in table.required)
                for column, kind, _ in table.columns
            ],
            metadata={b"huggingface": _HUGGING_FACE_IMAGE} if name == "images" else None,
        )
        for name, table in _tables().items()
    }


def _fingerprint(table: _Table) -> str:
    lines = sorted(f"{name} {kind} {name not in table.required}" for name, kind, _ in table.columns)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def _weight(text: str) -> str:
    marked = [line for line in text.splitlines() if line.startswith(_WEIGHT)]
    return marked[0].removeprefix(_WEIGHT).strip() if marked else "light"


def _arrow_type(kind: str) -> pa.DataType:
    """The Arrow type of an SQL type; lists, maps and structs of scalars included."""
    import pyarrow as pa

    if kind.endswith("[]"):
        return pa.list_(_arrow_type(kind.removesuffix("[]")))
    outer, _, inside = kind.rstrip(")").partition("(")
    inner = inside.split(", ")
    if outer == "map":
        return pa.map_(*map(_arrow_type, inner))
    if outer == "struct":
        named = [part.split(" ") for part in inner]
        return pa.struct([pa.field(name, _arrow_type(child)) for name, child in named])
    made: pa.DataType = getattr(pa, _SCALARS[kind])()
    return made
