"""An empty shell, an empty store, a folder for SQL of one's own."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import duckdb
import pytest

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.store import Store, open_store, schemas


@pytest.fixture
def shell() -> Iterator[duckdb.DuckDBPyConnection]:
    """A plain DuckDB connection with empty evidence tables."""
    with duckdb.connect() as connection:
        for table in EVIDENCE_TABLES:
            connection.execute(schemas.ddl(table))
        yield connection


@pytest.fixture
def store() -> Store:
    """An empty store in memory."""
    return open_store(f"memory://rules-{uuid.uuid4().hex}", create=True)


@pytest.fixture
def write_sql(tmp_path: Path) -> Callable[[str, str], Path]:
    """Writes a file of SQL into a folder of its own."""

    def write(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write
