"""Frozen lists of files, and pointers to selections."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from tcrdata.errors import ConflictError, StoreError
from tcrdata.store.commits import FileEntry, Unit, check_name, dump_json, parse_json
from tcrdata.store.filesystem import Filesystem

SNAPSHOTS = "snapshots"
SELECTIONS = "selections"
_SHORTEST_PREFIX = 6

Ids = Collection[str] | None
"""Ids of the only selections that count; None for all."""


@dataclass(frozen=True)
class Snapshot:
    """A frozen list of files; what lands in the store later is not in it.

    Attributes:
        name: the snapshot's name.
        tables: the tables it covers, also those without a file.
        files: ordered by dataset, sequence, round and stage.
    """

    name: str
    tables: tuple[str, ...]
    files: tuple[FileEntry, ...]

    def to_json(self) -> dict[str, Any]:
        """The snapshot as it lies in the store; its name is its file's."""
        files = [{**entry.to_json(), "unit": vars(entry.unit)} for entry in self.files]
        return {"tables": list(self.tables), "files": files}

    @staticmethod
    def from_json(
        name: str, content: Mapping[str, Any], drive: tuple[str, str] | None = None
    ) -> Snapshot:
        """Read `to_json` back, or of it the files of one dataset and sequence."""
        files = [
            FileEntry(**{**entry, "unit": Unit(**entry["unit"])})
            for entry in content["files"]
            if drive in (None, (entry["unit"]["dataset"], entry["unit"]["sequence"]))
        ]
        return Snapshot(name, tuple(content["tables"]), tuple(files))


def freeze(
    files: Filesystem, name: str | None, tables: Sequence[str], entries: Iterable[FileEntry]
) -> Snapshot:
    """Write a snapshot; without a name it is named by its content.

    Raises:
        ConflictError: the name is taken by another list of files.
        StoreError: the name cannot name a file.
    """
    snapshot = Snapshot(name or "", tuple(sorted(tables)), tuple(entries))
    data = dump_json(snapshot.to_json(), lines=False)
    name = name or hashlib.sha256(data).hexdigest()[:16]
    path = f"{SNAPSHOTS}/{check_name('the snapshot', name)}.json"
    if not files.create(path, data) and files.read(path) != data:
        raise ConflictError(
            f"{path} is already there with other files: a snapshot never changes, take another name"
        )
    return Snapshot(name, snapshot.tables, snapshot.files)


def read_snapshot(files: Filesystem, name: str, drive: tuple[str, str] | None = None) -> Snapshot:
    """Read a snapshot.

    Args:
        files: of the store.
        name: the snapshot's.
        drive: dataset and sequence: only their files; None for all.

    Raises:
        StoreError: there is none of that name, or its file is damaged.
    """
    path = f"{SNAPSHOTS}/{check_name('the snapshot', name)}.json"
    if files.size(path) is None:
        known = ", ".join(snapshot_names(files)) or "none"
        raise StoreError(f"{files.url} has no snapshot '{name}'; there are: {known}")
    return parse_json(
        path, files.read(path), "snapshot", lambda content: Snapshot.from_json(name, content, drive)
    )


def snapshot_names(files: Filesystem) -> list[str]:
    """Names of all snapshots, sorted."""
    return [stem(path) for path in files.find(SNAPSHOTS)]


def stem(path: str) -> str:
    """Name of a JSON file without folder and ending."""
    return path.rpartition("/")[2].removesuffix(".json")


def numbered(files: Filesystem, folder: str) -> list[int]:
    """Numbers of the files `<folder>/<n>.json`, rising."""
    return sorted(int(stem(path)) for path in files.find(folder) if stem(path).isdigit())


def point_to(files: Filesystem, selection_id: str, name: str) -> None:
    """Make a selection the newest one; nothing is written when it already is."""
    data = dump_json({"selection_id": selection_id, "name": name})
    while True:
        numbers = numbered(files, SELECTIONS)
        last = numbers[-1] if numbers else 0
        if last and files.read(f"{SELECTIONS}/{last}.json") == data:
            return
        if files.create(f"{SELECTIONS}/{last + 1}.json", data):
            return


def newest_selection(files: Filesystem, name: str | None, among: Ids = None) -> str | None:
    """Id of the newest selection, or of the newest that a name, an id or its beginning means.

    Args:
        files: of the store.
        name: None for the newest of all.
        among: ids of the only ones that count; None for all.

    Raises:
        StoreError: the beginning of an id fits several.
    """
    prefixed: set[str] = set()
    for number in reversed(numbered(files, SELECTIONS)):
        path = f"{SELECTIONS}/{number}.json"
        found, own_name = parse_json(
            path, files.read(path), "pointer to a selection", itemgetter("selection_id", "name")
        )
        if among is not None and found not in among:
            continue
        if name is None or name in (found, own_name):
            return str(found)
        if len(name) >= _SHORTEST_PREFIX and found.startswith(name):
            prefixed.add(found)
    if len(prefixed) > 1:
        raise StoreError(f"selection '{name}' is ambiguous: {', '.join(sorted(prefixed))}")
    return prefixed.pop() if prefixed else None
