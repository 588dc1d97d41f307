"""Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import duckdb
    import polars

    from tcrdata.store import Store

__version__ = "0.1.0"


def open(store: str) -> Handle:
    """Open a store for reading: `tcrdata.open(STORE).sql("from proposals limit 5")`.

    Args:
        store: a folder or any fsspec URL.

    Raises:
        StoreError: there is no store.
        SchemaError: the store has another schema version.
    """
    from tcrdata.store import open_store

    return Handle(open_store(store))


class Handle:
    """A store as it was when first asked; open it again to see what landed since."""

    def __init__(self, store: Store) -> None:
        self._store = store

    @cached_property
    def connection(self) -> duckdb.DuckDBPyConnection:
        """A DuckDB connection with a view a table, `checks` among them."""
        connection = self._store.connect()
        if selections := self._store.read("selections").to_pylist():
            self._add_checks(connection, selections)
        return connection

    def sql(self, query: str, **parameters: Any) -> duckdb.DuckDBPyRelation:
        """Run a query over the tables; `$name` in it takes the parameter of that name.

        Raises:
            QueryError: it does not run; the message is DuckDB's, in one line.
        """
        import duckdb

        from tcrdata.errors import QueryError

        try:
            return self.connection.sql(query, params=parameters or None)
        except duckdb.Error as error:
            raise QueryError(" ".join(str(error).split())) from error

    def table(self, name: str) -> polars.LazyFrame:
        """A table as a polars LazyFrame over its files; `checks` is worked out.

        Raises:
            SchemaError: there is no such table.
        """
        from tcrdata.store.schemas import is_view

        if is_view(name):
            frame: polars.DataFrame = self.sql(f"from {name}").pl()
            return frame.lazy()
        return self._store.scan(name)

    def _add_checks(
        self, connection: duckdb.DuckDBPyConnection, selections: list[dict[str, Any]]
    ) -> None:
        """Each selection is judged over the files it was made from, not over newer ones."""
        from tcrdata.rules import checks_view_sql

        parts = []
        for number, snapshot in enumerate(sorted({row["snapshot"] for row in selections})):
            rows = [row for row in selections if row["snapshot"] == snapshot]
            schema = f"snapshot_{number}"
            self._store.add_snapshot(
                connection, snapshot, schema, {"checks": checks_view_sql(rows)}
            )
            parts.append(f"select * from {schema}.checks")
        connection.execute("drop table checks")
        connection.execute("create view checks as " + " union all ".join(parts))
