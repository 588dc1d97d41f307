"""Reads commit records: the newest of each unit, each file once, folded ones in one request."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tcrdata.store.commits import (
    ANY_DATASET,
    COMMITS,
    CommitRecord,
    Unit,
    dump_json,
    generation_of,
    parse_json,
)
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.snapshots import numbered

CHECKPOINTS = "checkpoints"


class History:
    """The commit records of a store. Records never change, so each is read once and kept."""

    def __init__(self, files: Filesystem) -> None:
        self._files = files
        self._known: dict[str, CommitRecord] = {}
        self._folded = 0

    def newest(self, unit: Unit) -> CommitRecord | None:
        """The record of a unit with the highest generation; None when it is not done."""
        prefix = unit.record_path(0).removesuffix("0.json")
        found = [path for path in self._files.find(unit.folder) if path.startswith(prefix)]
        paths = _highest(found)
        return self._read(paths[0]) if paths else None

    def all_newest(self) -> list[CommitRecord]:
        """The newest record of every unit, sorted by dataset, sequence, round and stage."""
        paths = _highest(self._files.find(COMMITS))
        if any(path not in self._known for path in paths):
            self._load_checkpoint()
        return sorted((self._read(path) for path in paths), key=_order)

    def newest_of(self, dataset: str, sequence: str) -> list[CommitRecord]:
        """Of these the ones that may hold rows of a sequence, found without a look at the others.

        Those are the sequence's own and the ones of units whose rows belong to any dataset.
        """
        found = self._files.find(f"{COMMITS}/{dataset}/{sequence}")
        if dataset != ANY_DATASET:
            found += self._files.find(f"{COMMITS}/{ANY_DATASET}")
        return sorted((self._read(path) for path in _highest(found)), key=_order)

    def checkpoint(self, least: int) -> bool:
        """Fold every record into one file, if at least so many are in none yet."""
        paths = self._files.find(COMMITS)
        self._load_checkpoint()
        if len(paths) - self._folded < max(least, 1):
            return False
        records = [self._read(path).to_json() for path in paths]
        numbers = numbered(self._files, CHECKPOINTS)
        name = f"{CHECKPOINTS}/{numbers[-1] + 1 if numbers else 1}.json"
        return self._files.create(name, dump_json({"records": records}, lines=False))

    def _load_checkpoint(self) -> None:
        numbers = numbered(self._files, CHECKPOINTS)
        if not numbers:
            return
        path = f"{CHECKPOINTS}/{numbers[-1]}.json"
        records = parse_json(path, self._files.read(path), "checkpoint", _records)
        for record in records:
            self._known.setdefault(record.unit.record_path(record.generation), record)
        self._folded = len(records)

    def _read(self, path: str) -> CommitRecord:
        if path not in self._known:
            self._known[path] = parse_json(
                path, self._files.read(path), "commit record", CommitRecord.from_json
            )
        return self._known[path]


def _records(content: dict[str, Any]) -> list[CommitRecord]:
    return [CommitRecord.from_json(folded) for folded in content["records"]]


def _order(record: CommitRecord) -> tuple[str, str, int, str]:
    unit = record.unit
    return unit.dataset, unit.sequence, unit.round, unit.stage


def _highest(paths: Iterable[str]) -> list[str]:
    """Of the records of each unit the one with the highest generation."""
    newest: dict[str, int] = {}
    for path in paths:
        unit, generation = generation_of(path)
        newest[unit] = max(generation, newest.get(unit, 0))
    return [f"{unit}.g{generation}.json" for unit, generation in newest.items()]
