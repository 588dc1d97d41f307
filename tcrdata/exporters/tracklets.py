"""Tracklets in the place of labels, for formats of objects over time."""

from __future__ import annotations

import duckdb

from tcrdata.errors import MissingEvidenceError
from tcrdata.reports import run_report


def tracklets_as_labels(connection: duckdb.DuckDBPyConnection, selection_id: str) -> None:
    """Let `labels` be the tracklets of a selection: with the library where there are any.

    Args:
        connection: has `labels`, `selections` and `tracklets`.
        selection_id: whose labels were followed.

    Raises:
        MissingEvidenceError: nothing was tracked.
    """
    parameters = {"selection_id": selection_id}
    rows = run_report(connection, "exported_tracklets", parameters).to_arrow_table()
    if not rows.num_rows:
        raise MissingEvidenceError(
            f"there are no tracklets of selection {selection_id[:12]}: run `tcrdata track "
            f"--selection {selection_id[:12]}` first"
        )
    connection.register("_tracklets_as_labels", rows)
    connection.execute("create or replace view labels as from _tracklets_as_labels")
