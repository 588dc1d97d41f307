"""WebDataset: `{000000..N}.tar`, a frame a sample: `<sequence>/<frame>.png` and `.json`.

Members with one name before the first dot of the base name, one after the other, are a sample.
Source: the WebDataset format specification of the `webdataset` package.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tcrdata.exporters.frame_records import (
    conventions,
    named_sequences,
    pictured_records,
    runs_of,
)
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    chosen_labels,
    open_folder,
)
from tcrdata.store import Store

SHARD_BYTES = 512_000_000
"""A shard ends before it would grow beyond this; a sample larger than that has one of its own."""

_BLOCK_BYTES = 512
_ENCODER = json.JSONEncoder(allow_nan=False)


@dataclass(frozen=True)
class _Sample:
    """The members of a sample: their bytes by suffix."""

    name: str
    members: dict[str, bytes]

    @property
    def size(self) -> int:
        """Bytes in a tar file: a header a member, and data in whole blocks."""
        blocks = sum(1 + -(-len(data) // _BLOCK_BYTES) for data in self.members.values())
        return blocks * _BLOCK_BYTES


def export(
    store: Store,
    selection_id: str,
    out: str | Path,
    options: ExportOptions | None = None,
    *,
    shard_bytes: int = SHARD_BYTES,
) -> Card:
    """Write every frame with its image and its labels; frames without labels too.

    Args:
        store: holds the selection; its dataset's images must still be where the build read them.
        selection_id: of the labels.
        out: folder that gets `000000.tar` and so on.
        options: which labels, and how.
        shard_bytes: most that a shard holds.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, or no positive label.
        FrameError: an image is gone since the build.
    """
    options = options or ExportOptions()
    with chosen_labels(store, selection_id, options) as chosen:
        folder = open_folder(out, options.overwrite)
        shards, images = _write(folder, _samples(chosen, options), shard_bytes)
    _remove_older(folder, shards)
    return _card(str(out), options, shards, chosen, images)


def _samples(chosen: ChosenLabels, options: ExportOptions) -> Iterator[_Sample]:
    for part in named_sequences(chosen):
        for record, image in pictured_records(part, options):
            members = {} if image is None else {image.suffix: image.data}
            members[".json"] = _ENCODER.encode(record).encode()
            yield _Sample(f"{part.sequence}/{record['frame']:06d}", members)


def _write(folder: Path, samples: Iterator[_Sample], limit: int) -> tuple[int, int]:
    """Write samples into shards; returns how many shards, and how many samples with an image."""
    shards, images = 0, 0
    # A tar file ends with empty blocks, up to a whole record.
    for run in runs_of(samples, lambda sample: sample.size, limit - tarfile.RECORDSIZE):
        with tarfile.open(folder / _shard_name(shards), "w") as tar:
            for sample in run:
                _add(tar, sample)
                images += len(sample.members) > 1
        shards += 1
    return shards, images


def _add(tar: tarfile.TarFile, sample: _Sample) -> None:
    """Add a sample without a clock or an owner: equal samples make equal bytes."""
    for suffix, data in sample.members.items():
        entry = tarfile.TarInfo(sample.name + suffix)
        entry.size = len(data)
        tar.addfile(entry, io.BytesIO(data))


def _shard_name(number: int) -> str:
    return f"{number:06d}.tar"


def _remove_older(folder: Path, count: int) -> None:
    """Remove shards of an earlier, longer export: a reader would take them for a part of this."""
    for path in folder.glob("[0-9]" * 6 + ".tar"):
        if int(path.stem) >= count:
            path.unlink()


def _card(out: str, options: ExportOptions, shards: int, chosen: ChosenLabels, images: int) -> Card:
    pattern = f"{{{0:06d}..{shards - 1:06d}}}.tar"
    own = (
        ("file", f"{pattern}: a sample is <sequence>/<frame>.png (the dataset's suffix) and .json"),
        ("images", f"in {images} of {chosen.frames} samples; the others have .json alone"),
        *conventions(options),
    )
    return Card("webdataset", out, shards, chosen.total, chosen.ignored, own)
