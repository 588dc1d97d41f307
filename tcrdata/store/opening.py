"""Opens a store, or makes one."""

from __future__ import annotations

from operator import itemgetter

from tcrdata.errors import SchemaError, StoreError
from tcrdata.store.commits import dump_json, parse_json
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.schemas import SCHEMA_VERSION
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
        SchemaError: it has another schema version.
    """
    files = Filesystem(str(url))
    if files.size(_STORE_FILE) is None:
        if not create:
            raise StoreError(f"there is no store at {url}: make one with `tcrdata build`")
        # Another build may have made it between the two looks.
        if not files.is_empty() and files.size(_STORE_FILE) is None:
            raise StoreError(f"{url} is not a store and not empty: give a new or empty folder")
        files.create(_STORE_FILE, dump_json({"schema_version": SCHEMA_VERSION}))
    version = parse_json(
        files.full_path(_STORE_FILE),
        files.read(_STORE_FILE),
        "store's description",
        itemgetter("schema_version"),
    )
    if version != SCHEMA_VERSION:
        raise SchemaError(
            f"the store {url} has schema version {version}, this tcrdata reads {SCHEMA_VERSION}: "
            "build into a new store, or use the tcrdata that made it"
        )
    if create:
        files.sweep()
    return Store(files)
