"""What a report reads: one selection, the evidence it was made from, and maybe only some drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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


def read_selection(store: Store, selection_id: str, sequences: Sequence[str] | None) -> Reading:
    """Open a selection over the files it was made from.

    Args:
        store: holds it.
        selection_id: of the selection.
        sequences: read these drives alone; None for all.

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
    drives = _drives(store, row, sequences)
    views = {"checks": checks_view_sql([row]), "verdicts": verdicts_view_sql([row])}
    store.add_snapshot(
        connection, row["snapshot"], _JUDGED, views, tables=EVIDENCE_TABLES, sequences=drives
    )
    for name in (*EVIDENCE_TABLES, *views):
        connection.execute(f"create view {name} as from {_JUDGED}.{name}")
    if drives is not None:
        for table in _NOT_JUDGED:
            _narrow(connection, table)
    return Reading(store, connection, row, tuple(sequences) if sequences else None)


def _drives(
    store: Store, selection: Mapping[str, Any], sequences: Sequence[str] | None
) -> frozenset[tuple[str, str]] | None:
    """Dataset and sequence of the drives that are asked for; None for all."""
    if not sequences:
        return None
    units = {entry.unit for entry in store.snapshot(selection["snapshot"]).files}
    known = sorted({unit.sequence for unit in units})
    for name in sequences:
        if name not in known:
            some = ", ".join(known[:8]) or "none"
            raise MissingEvidenceError(f"the selection has no sequence '{name}'; there are: {some}")
    return frozenset((u.dataset, u.sequence) for u in units if u.sequence in sequences)


def _narrow(connection: duckdb.DuckDBPyConnection, table: str) -> None:
    """Put the rows of the drives that are read in the place of a table."""
    (word,) = connection.execute(
        "select if(table_type = 'VIEW', 'view', 'table') from information_schema.tables "
        "where table_schema = 'main' and table_name = ?",
        [table],
    ).fetchall()[0]
    connection.execute(f"alter {word} {table} rename to all_{table}")
    connection.execute(
        f"create view {table} as from all_{table} semi join sequences using (dataset, sequence)"
    )
