"""Units of work and the records that make them visible.

A record is a JSON file at `commits/<dataset>/<sequence>/<stage>.r<round>.g<generation>.json`.
It lands last and exclusively: what no record names does not exist for a reader.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, TypeVar

from tcrdata.errors import StoreError

T = TypeVar("T")

COMMITS = "commits"
ANY_DATASET = "_"
"""The dataset of units whose rows may belong to several datasets, such as selections."""

_ALLOWED = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-")


def check_name(what: str, name: str) -> str:
    """Return a name that is safe as a folder's or a file's.

    Raises:
        StoreError: it is empty, starts with a dot, or has a character other than A-Za-z0-9._-
    """
    if not name or name.startswith(".") or not _ALLOWED.issuperset(name):
        raise StoreError(
            f"{what} {name!r} cannot name a folder of the store: "
            "use letters, digits, '.', '_' and '-', not starting with a dot"
        )
    return name


@dataclass(frozen=True, order=True)
class Unit:
    """What is done and committed as a whole.

    Attributes:
        stage: the cue or step that makes it.
        dataset: the dataset's name, or `_` where rows belong to several.
        sequence: the drive or clip; for selections their id.
        round: EM round, 1-based.

    Raises:
        StoreError: a name holds a character that no folder's name should.
    """

    stage: str
    dataset: str
    sequence: str
    round: int

    def __post_init__(self) -> None:
        check_name("the stage", self.stage)
        check_name("the dataset", self.dataset)
        check_name("the sequence", self.sequence)

    def __str__(self) -> str:
        return f"{self.stage} of {self.dataset}/{self.sequence}, round {self.round}"

    @property
    def folder(self) -> str:
        """Folder of its records, relative to the store."""
        return f"{COMMITS}/{self.dataset}/{self.sequence}"

    def may_hold(self, dataset: str | None, sequence: str | None, round: int | None) -> bool:
        """Whether its files may hold rows with these keys; None asks for any."""
        if self.dataset == ANY_DATASET and dataset != ANY_DATASET:
            return True
        pairs = ((self.dataset, dataset), (self.sequence, sequence), (self.round, round))
        return all(asked is None or own == asked for own, asked in pairs)

    def record_path(self, generation: int) -> str:
        """Path of one of its records, relative to the store."""
        return f"{self.folder}/{self.stage}.r{self.round}.g{generation}.json"


@dataclass(frozen=True)
class FileEntry:
    """A Parquet file that a record names.

    Attributes:
        table: the table whose rows it holds.
        path: relative to the store.
        rows: number of rows.
        bytes: its size.
        sha256: of its content.
        unit: the unit that wrote it.
    """

    table: str
    path: str
    rows: int
    bytes: int
    sha256: str
    unit: Unit

    def to_json(self) -> dict[str, Any]:
        """Everything but the unit, which the record holds once."""
        names = ("table", "path", "rows", "bytes", "sha256")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class CommitRecord:
    """What a unit wrote, from what, with which settings.

    Attributes:
        unit: the unit.
        generation: 1 for the first; a redo with other settings or inputs takes the next.
        settings_hash: hash of the settings used.
        inputs: name to digest of everything it was made from.
        tables: rows a table, tables that got none included.
        files: in the order in which they were written.
        failed_frames: (frame, one line) of frames that could not be done.
    """

    unit: Unit
    generation: int
    settings_hash: str
    inputs: Mapping[str, str]
    tables: Mapping[str, int]
    files: tuple[FileEntry, ...]
    failed_frames: tuple[tuple[int, str], ...] = field(default=())

    @cached_property
    def digest(self) -> str:
        """sha256 of the content; the generation aside, so that equal work has equal digests."""
        content = {key: v for key, v in self.to_json().items() if key != "generation"}
        return hashlib.sha256(dump_json(content, lines=False)).hexdigest()

    def matches(self, settings_hash: str, inputs: Mapping[str, str]) -> bool:
        """Whether it was made with these settings, from these inputs."""
        return self.settings_hash == settings_hash and dict(self.inputs) == dict(inputs)

    def to_json(self) -> dict[str, Any]:
        """The record as it lies in the store."""
        return {
            "unit": asdict(self.unit),
            "generation": self.generation,
            "settings_hash": self.settings_hash,
            "inputs": dict(self.inputs),
            "tables": dict(self.tables),
            "files": [entry.to_json() for entry in self.files],
            "failed_frames": [list(failure) for failure in self.failed_frames],
        }

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> CommitRecord:
        """Read `to_json` back."""
        unit = Unit(**content["unit"])
        return CommitRecord(
            unit=unit,
            generation=content["generation"],
            settings_hash=content["settings_hash"],
            inputs=content["inputs"],
            tables=content["tables"],
            files=tuple(FileEntry(**entry, unit=unit) for entry in content["files"]),
            failed_frames=tuple((frame, error) for frame, error in content["failed_frames"]),
        )


def dump_json(content: Any, *, lines: bool = True) -> bytes:
    """The one way JSON is written here: sorted keys, so that equal content is equal bytes.

    Args:
        content: plain values.
        lines: a line an entry, for people; long lists of files are written in one, in a tenth of
            the time.
    """
    indent = 1 if lines else None
    return (json.dumps(content, indent=indent, sort_keys=True, ensure_ascii=False) + "\n").encode()


def parse_json(path: str, data: bytes, what: str, parse: Callable[[Any], T]) -> T:
    """Parse a JSON file of the store.

    Args:
        path: for the message.
        data: the file's content.
        what: what it should be.
        parse: makes that of the parsed JSON.

    Raises:
        StoreError: it is torn, damaged or something else; names it.
    """
    try:
        content = json.loads(data)
    except ValueError as error:
        raise StoreError(
            f"{path} is damaged ({error}): restore it, or delete it and run again"
        ) from error
    try:
        return parse(content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(
            f"{path} is not a {what} ({error}): restore it, or delete it and run again"
        ) from error


def generation_of(path: str) -> tuple[str, int]:
    """Split a record's path into what names its unit and its generation.

    Raises:
        StoreError: the file does not belong there.
    """
    head, _, number = path.removesuffix(".json").rpartition(".g")
    if not head or not number.isdigit() or not path.endswith(".json"):
        raise StoreError(f"{path} is not a commit record: move it out of the store")
    return head, int(number)
