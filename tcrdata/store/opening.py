"""Opens a store, or makes one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcrdata.errors import SchemaError, StoreError
from tcrdata.store.commits import dump_json, parse_json
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.schemas import SCHEMA_VERSION, fingerprints
from tcrdata.store.store import Store

_STORE_FILE = "store.json"


def store_exists(url: str) -> bool:
    """Whether there is a store, of whatever version, at a URL."""
    return Filesystem(str(url)).size(_STORE_FILE) is not None


def open_store(url: str, create: bool = False) -> Store:
    """Open a store.

    Args:
        url: a folder or any fsspec URL.
        create: make it when nothing is there, and clean up after killed writers.

    Raises:
        StoreError: there is no store, or the folder holds something else.
        SchemaError: it has another schema version, or a table of it has other columns.
    """
    files = Filesystem(str(url))
    if files.size(_STORE_FILE) is None:
        if not create:
            raise StoreError(f"there is no store at {url}: make one with `tcrdata build`")
        # Another build may have made it between the two looks.
        if not files.is_empty() and files.size(_STORE_FILE) is None:
            raise StoreError(f"{url} is not a store and not empty: give a new or empty folder")
        content = {"schema_version": SCHEMA_VERSION, "tables": fingerprints()}
        files.create(_STORE_FILE, dump_json(content))
    version, tables = parse_json(
        files.full_path(_STORE_FILE),
        files.read(_STORE_FILE),
        "store's description",
        lambda found: (found["schema_version"], dict(found.get("tables", {}))),
    )
    _check_schema(files.url, version, tables)
    if create:
        files.sweep()
    return Store(files)


def _check_schema(url: str, version: Any, tables: Mapping[str, str]) -> None:
    """Refuse a store that was made with other tables than there are now.

    A table that only one of the two knows does no harm. A store made before fingerprints were kept
    has none: what its files lack is told when a table is read.
    """
    what_to_do = "build into a new store, or use the tcrdata that made it"
    if version != SCHEMA_VERSION:
        raise SchemaError(
            f"the store {url} has schema version {version}, this tcrdata reads {SCHEMA_VERSION}: "
            + what_to_do
        )
    present = fingerprints()
    if other := [
        name for name in sorted(tables) if present.get(name, tables[name]) != tables[name]
    ]:
        raise SchemaError(
            f"the store {url} has schema version {version} as this tcrdata, but its "
            f"{'tables' if len(other) > 1 else 'table'} {', '.join(other)} had other columns when "
            f"it was made: {what_to_do}"
        )
