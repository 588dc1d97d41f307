"""A full disk is one line; nothing half made is visible, and the next build ends byte-equal."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
from pathlib import Path
from typing import Any

import pytest
from cli_runs import build_command, done, refused
from kitti_tree import write_raw
from store_files import digests

from tcrdata.store import open_store
from tcrdata.store.filesystem import _LocalStaging

FRAMES = 5


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    return folder


@pytest.fixture(scope="module")
def reference(intact: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    store = tmp_path_factory.mktemp("reference") / "store"
    done(*build_command(intact, store))
    return digests(store)


class Disk:
    """Room for so many bytes more."""

    def __init__(self, free_bytes: int) -> None:
        self.free_bytes = free_bytes

    def open(self, staging: Any) -> Any:
        staging._count += 1
        return io.BufferedWriter(File(self, staging._folder / f"{staging._count}"))


class File(io.FileIO):
    """A file on such a disk."""

    def __init__(self, disk: Disk, path: Path) -> None:
        super().__init__(path, "xb")
        self._disk = disk

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        if size > self._disk.free_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._disk.free_bytes -= size
        return super().write(data)


@pytest.mark.parametrize("free_bytes", [0, 5_000, 20_000, 40_000, 70_000])
def test_a_full_disk_loses_nothing_and_shows_nothing_half_made(
    intact: Path, reference: dict[str, str], tmp_path: Path, free_bytes: int
) -> None:
    full = tmp_path / "store"
    disk = Disk(free_bytes)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_LocalStaging, "open", lambda staging: disk.open(staging))
        line = refused(*build_command(intact, full))
    assert "the disk is full; free some space and run again, what was committed is kept" in line
    assert not list(full.glob("tmp/*"))
    if (full / "store.json").is_file():
        whole = {entry.path: entry for r in open_store(str(full)).records() for entry in r.files}
        for path, entry in whole.items():
            assert hashlib.sha256((full / path).read_bytes()).hexdigest() == entry.sha256
        for record in (full / "commits").rglob("*.json"):
            json.loads(record.read_text())
    done(*build_command(intact, full))
    assert digests(full) == reference
