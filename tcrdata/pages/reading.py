"""What a report reads: one selection, the evidence it was made from, and maybe only some drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcrdata.errors import MissingEvidenceError
from tcrdata.reports import run_report
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.checks import checks_view_sql, verdicts_view_sql

if TYPE_CHECKING:
    import duckdb

    from tcrdata.store import Store

_JUDGED = "judged"
_NOT_JUDGED = ("labels", "ground_truth")
_MEMORY = "1GB"  # beyond it DuckDB spills: a store may hold millions of candidates


@dataclass(frozen=True)
class Reading:
    """A connection whose tables hold one selection, its evidence and its verdicts.

    Attributes:
        store: where it comes from.
        connection: views of the store's tables, `checks` of this selection among them.
        selection: its row of `selections`.
        sequences: the drives that are read; None for all.
    """

    store: Store
    connection: duckdb.DuckDBPyConnection
    selection: Mapping[str, Any]
    sequences: tuple[str, ...] | None

    def rows(self, report: str, **parameters: Any) -> list[dict[str, Any]]:
        """Run a file of `queries/reports/`; the selection's id is filled in where it is asked."""
        found = run_report(self.connection, report, parameters).to_arrow_table().to_pylist()
        return [dict(row) for row in found]

    def selected(self, report: str, **parameters: Any) -> list[dict[str, Any]]:
        """As `rows`, of this selection."""
        return self.rows(report, selection_id=self.selection["selection_id"], **parameters)


def read_selection(
    store: Store, selection_id: str, sequences: Sequence[str] | None, spill: Path
) -> Reading:
    """Open a selection over the files it was made from.

    Args:
        store: holds it.
        selection_id: of the selection.
        sequences: read these drives alone; None for all.
        spill: folder for what does not fit into memory.

    Raises:
        MissingEvidenceError: there is no such selection, or no drive of a name.
    """
    rows = store.read("selections").to_pylist()
    row = next((row for row in rows if row["selection_id"] == selection_id), None)
    if row is None:
        raise MissingEvidenceError(
            f"{store.url} has no selection '{selection_id}': make one with `tcrdata check`"
        )
    connection = store.connect(tables=("selections", *_NOT_JUDGED))
    connection.execute(f"set memory_limit = '{_MEMORY}'")
    connection.execute(f"set temp_directory = {_quoted(str(spill))}")
    # Each query sorts its own rows at its end; holding their order before costs memory.
    connection.execute("set preserve_insertion_order = false")
    store.add_snapshot(connection, row["snapshot"], _JUDGED, tables=EVIDENCE_TABLES)
    kept = _condition(store, row["snapshot"], sequences)
    for table in EVIDENCE_TABLES:
        connection.execute(f"create view {table} as from {_JUDGED}.{table} {kept}")
    # Made in the same schema as those views, the rules read some drives, too.
    for name, sql in (("checks", checks_view_sql([row])), ("verdicts", verdicts_view_sql([row]))):
        connection.execute(f"create view {name} as {sql}")
    if kept:
        for table in _NOT_JUDGED:
            _narrow(connection, table, kept)
    return Reading(store, connection, row, tuple(sequences) if sequences else None)


def _condition(store: Store, snapshot: str, sequences: Sequence[str] | None) -> str:
    """The `where` that keeps the drives that are asked for; empty for all."""
    if not sequences:
        return ""
    known = sorted({entry.unit.sequence for entry in store.snapshot(snapshot).files})
    for name in sequences:
        if name not in known:
            some = ", ".join(known[:8]) or "none"
            raise MissingEvidenceError(f"the selection has no sequence '{name}'; there are: {some}")
    return f"where sequence in ({', '.join(_quoted(name) for name in sequences)})"


def _narrow(connection: duckdb.DuckDBPyConnection, table: str, kept: str) -> None:
    """Put the rows of the drives that are asked for in the place of a table."""
    (word,) = connection.execute(
        "select if(table_type = 'VIEW', 'view', 'table') from information_schema.tables "
        "where table_schema = 'main' and table_name = ?",
        [table],
    ).fetchall()[0]
    connection.execute(f"alter {word} {table} rename to all_{table}")
    connection.execute(f"create view {table} as from all_{table} {kept}")


def _quoted(value: str) -> str:
    """A string as an SQL literal."""
    return "'" + value.replace("'", "''") + "'"
