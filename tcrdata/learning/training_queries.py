"""What a training sample is: a query over the store, one row a frame."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcrdata.errors import QueryError, SettingsError
from tcrdata.resources import resource_files, resource_folder

if TYPE_CHECKING:
    import duckdb

KEYS = ("dataset", "sequence", "frame")
FLOWS = {"flow": "forward", "flow_backward": "backward"}
"""Names of flow that `-- reads:` may name, and the direction of each in the table `flows`."""

SOURCES = ("image", "points", *FLOWS)
"""What `-- reads:` may name beside the cues of `point_evidence`."""

_READS = re.compile(r"^--\s*reads:(.*(?:\n--   .*)*)", re.MULTILINE)


@dataclass(frozen=True)
class TrainingQuery:
    """A query that gives the frames to learn from.

    Attributes:
        name: for messages.
        text: `set variable` lines and one select with columns dataset, sequence and frame.
        reads: what is read for each frame: image, points, flow, cues of `point_evidence`.
    """

    name: str
    text: str
    reads: tuple[str, ...]

    @property
    def cues(self) -> tuple[str, ...]:
        """The cues of `point_evidence` among what is read."""
        return tuple(name for name in self.reads if name not in SOURCES)


def load_training_query(query: str) -> TrainingQuery:
    """Read a query: the name of a file of `queries/training/`, a path, or SQL itself.

    Its line `-- reads: image, points, ground` names what is read for each frame.

    Raises:
        SettingsError: there is no such file.
    """
    text = query
    if not any(letter.isspace() for letter in query.strip()):
        path = Path(query)
        if path.suffix != ".sql":
            path = resource_folder("queries") / "training" / f"{query}.sql"
        if not path.is_file():
            known = ", ".join(file.stem for file in resource_files("queries/training/*.sql"))
            raise SettingsError(
                f"no training query '{query}': there are {known}; or give a .sql file or SQL"
            )
        text = path.read_text(encoding="utf-8")
    named = _READS.search(text)
    listed = named.group(1).replace("\n--", " ").split(",") if named else []
    name = query if text is not query else "the training query"
    return TrainingQuery(name, text, tuple(part.strip() for part in listed if part.strip()))


def run_training_query(
    connection: duckdb.DuckDBPyConnection, query: TrainingQuery, parameters: Mapping[str, Any]
) -> str:
    """Run the query's `set variable` lines with these values; return its bare select.

    Raises:
        SettingsError: a parameter that the query does not set, or a value of another type.
        QueryError: the SQL does not run or lacks a key column; names the query.
    """
    import duckdb

    try:
        *setters, select = connection.extract_statements(query.text)
        for setter in setters:
            connection.execute(setter.query)
        _override(connection, query, parameters)
        found = {row[0] for row in connection.execute(f"describe ({select.query})").fetchall()}
    except (duckdb.Error, ValueError) as error:
        raise QueryError(f"{query.name}: {' '.join(str(error).split())}") from error
    if missing := [name for name in KEYS if name not in found]:
        raise QueryError(
            f"{query.name}: its select lacks the column {missing[0]}: a sample is a frame, named "
            "by dataset, sequence and frame"
        )
    return str(select.query)


def _override(
    connection: duckdb.DuckDBPyConnection, query: TrainingQuery, parameters: Mapping[str, Any]
) -> None:
    """Replace variables; a value takes the type that the file's own has."""
    import duckdb

    kinds = dict(connection.execute("select name, type from duckdb_variables()").fetchall())
    for name, value in parameters.items():
        if name not in kinds:
            known = ", ".join(sorted(kinds)) or "none"
            raise SettingsError(f"{query.name} has no parameter '{name}': it has {known}")
        try:
            connection.execute(f"set variable {name} = ?::{kinds[name]}", [value])
        except duckdb.Error as error:
            raise SettingsError(
                f"{query.name}: {name} must be a {kinds[name].lower()}, not {value!r}"
            ) from error


def parameter_values(connection: duckdb.DuckDBPyConnection) -> dict[str, str]:
    """Return the variables set on a connection, as text: what a run is recorded with."""
    rows = connection.execute("select name, value from duckdb_variables() order by name")
    return dict(rows.fetchall())
