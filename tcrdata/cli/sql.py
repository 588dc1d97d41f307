"""`tcrdata sql`: queries over a store."""

from __future__ import annotations

import csv as csv_files
import sys

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.errors import SettingsError

ROWS_A_WRITE = 10_000


def sql(
    query: str,
    *,
    store: StoreUrl,
    json: Flag = False,
    csv: Flag = False,
) -> int:
    """Run SQL over the tables of a store.

    Args:
        query: DuckDB SQL, such as `select source, count(*) from proposals group by all`.
        store: folder or URL of the store.
        json: print the rows as a JSON array.
        csv: print the rows as CSV.
    """
    import duckdb

    import tcrdata
    from tcrdata.store.views import query_error

    if json and csv:
        raise SettingsError("--json and --csv: choose one")
    if not query.strip():
        raise SettingsError("the query is empty: write such as 'select count(*) from proposals'")
    handle = tcrdata.open(store)
    try:
        if not json and not csv:
            relation = handle.sql(query)
            sys.stdout.write(f"{relation}\n" if relation is not None else "")
            return 0
        cursor = handle.connection.execute(query)
        names = [column[0] for column in cursor.description or ()]
        if json:
            rows = cursor.fetchall()
            console.print_json([dict(zip(names, row, strict=True)) for row in rows])
            return 0
        writer = csv_files.writer(sys.stdout, lineterminator="\n")
        writer.writerow(names)
        while rows := cursor.fetchmany(ROWS_A_WRITE):
            writer.writerows(rows)
    except duckdb.Error as error:
        raise query_error(error) from error
    return 0
