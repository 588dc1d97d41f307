"""Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import duckdb
    import polars

    from tcrdata.learning.stream import FrameStream
    from tcrdata.store import Store

__version__ = "0.2.0"


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


def torch_dataset(store: str, query: str, **options: Any) -> FrameStream:
    """Return the frames of a training query as a torch IterableDataset.

    `DataLoader(tcrdata.torch_dataset(STORE, "detector"), batch_size=None, num_workers=2)`

    Args:
        store: folder or URL of the store.
        query: name of a file of `queries/training/`, a path, or SQL.
        **options: see `tcrdata.learning.stream.torch_dataset`.
    """
    from tcrdata.learning.stream import torch_dataset as stream

    return stream(store, query, **options)


class Handle:
    """A store as it was when first asked; open it again to see what landed since."""

    def __init__(self, store: Store) -> None:
        self._store = store

    @cached_property
    def connection(self) -> duckdb.DuckDBPyConnection:
        """A DuckDB connection with a view a table, `checks` and `verdicts` among them."""
        from tcrdata.rules.checks import add_rule_views

        connection = self._store.connect()
        add_rule_views(self._store, connection, self._store.read("selections").to_pylist())
        return connection

    def sql(self, query: str, **parameters: Any) -> duckdb.DuckDBPyRelation:
        """Run a query over the tables; `$name` in it takes the parameter of that name.

        Raises:
            QueryError: it does not run; the message is DuckDB's, in one line.
        """
        import duckdb

        from tcrdata.store.views import query_error

        try:
            return self.connection.sql(query, params=parameters or None)
        except duckdb.Error as error:
            raise query_error(error) from error

    def table(self, name: str) -> polars.LazyFrame:
        """A table as a polars LazyFrame over its files; `checks` and `verdicts` are worked out.

        Raises:
            SchemaError: there is no such table.
        """
        from tcrdata.store.schemas import is_view

        if is_view(name):
            frame: polars.DataFrame = self.sql(f"from {name}").pl()
            return frame.lazy()
        return self._store.scan(name)
