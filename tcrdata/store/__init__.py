"""Immutable Parquet, commit records and snapshots, on any fsspec URL."""

from tcrdata.store.commits import CommitRecord, FileEntry, Unit
from tcrdata.store.opening import open_store, store_exists
from tcrdata.store.snapshots import Snapshot
from tcrdata.store.store import Store

__all__ = ["CommitRecord", "FileEntry", "Snapshot", "Store", "Unit", "open_store", "store_exists"]
