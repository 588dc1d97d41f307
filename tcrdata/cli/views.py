"""`tcrdata views`: a store for any DuckDB shell."""

from __future__ import annotations

import sys

from tcrdata.cli.app import StoreUrl


def views(*, store: StoreUrl) -> int:
    """Print `create view` statements with which any DuckDB shell reads the store.

    Args:
        store: folder of the store.
    """
    import tcrdata
    from tcrdata.errors import StoreError

    if "://" in store and not store.startswith("file:"):
        raise StoreError(f"{store}: views are for a store in a local folder: copy it to one")
    handle = tcrdata.open(store)
    definitions = handle.connection.execute(
        """
        select 'create schema if not exists ' || schema_name || ';'
        from duckdb_schemas() where not internal and schema_name <> 'main'
        union all
        (select sql from duckdb_tables() where not internal order by table_oid)
        union all
        (select sql from duckdb_views() where not internal order by view_oid)
        """
    ).fetchall()
    for (sql,) in definitions:
        sys.stdout.write(f"{sql}\n")
    return 0
