"""Bundles: files that hold the rows of many small ones, and stand for them in queries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tcrdata.store.commits import FileEntry, parse_json
from tcrdata.store.filesystem import Filesystem

COMPACTED = "compacted"


@dataclass(frozen=True)
class Bundle:
    """A file that holds the rows of others.

    Attributes:
        table: whose rows.
        path: relative to the store.
        rows: number of rows.
        bytes: its size.
        sha256: of its content.
        holds: paths of the files whose rows it has, in order.
    """

    table: str
    path: str
    rows: int
    bytes: int
    sha256: str
    holds: tuple[str, ...]


def read_bundles(files: Filesystem) -> list[Bundle]:
    """The bundles of a store, those of most files first."""
    found = [
        parse_json(path, files.read(path), "bundle", _from_json)
        for path in files.find(COMPACTED)
        if path.endswith(".json")
    ]
    return sorted(found, key=lambda bundle: (-len(bundle.holds), bundle.path))


def stand_ins(bundles: Sequence[Bundle], entries: Sequence[FileEntry]) -> list[FileEntry]:
    """The entries with bundles in the place of the files that they hold, where all are asked for.

    Args:
        bundles: of any tables.
        entries: files of one table.
    """
    left = {entry.path: entry for entry in entries}
    found = []
    for bundle in bundles:
        if left.keys() >= set(bundle.holds):
            unit = left[bundle.holds[0]].unit
            found.append(
                FileEntry(bundle.table, bundle.path, bundle.rows, bundle.bytes, bundle.sha256, unit)
            )
            for path in bundle.holds:
                del left[path]
    return found + list(left.values())


def _from_json(content: Mapping[str, Any]) -> Bundle:
    return Bundle(**{**content, "holds": tuple(content["holds"])})
