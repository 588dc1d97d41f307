"""Frames under running numbers, for formats that know no sequences: who is who, and the splits."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from tcrdata.exporters.labels import ExportOptions, SequenceLabels

INDEX = "frames.csv"
_COLUMNS = ("name", "dataset", "sequence", "frame", "timestamp_ns", "split", "labels", "ignored")
_SPLITS = {"train": ("train", "trainval"), "val": ("val", "trainval"), "": ()}


class NumberedFrames:
    """Names the frames 000000, 000001 ... and writes `frames.csv` and `ImageSets/` meanwhile."""

    def __init__(self, index: IO[str], lists: Mapping[str, IO[str]], validation: frozenset[str]):
        self._index = csv.writer(index, lineterminator="\n")
        self._index.writerow(_COLUMNS)
        self._lists = lists
        self._validation = validation
        self.count = 0

    def add(self, part: SequenceLabels) -> tuple[list[str], list[str]]:
        """Return the name and the split of each frame of the next sequence.

        A frame without positive labels is in no split (''): that nothing was found there does
        not say that nothing is there.
        """
        frames = part.frames
        split = "val" if part.sequence in self._validation else "train"
        rows = np.arange(frames.num_rows)
        positive = np.bincount(part.frame_rows[part.positive], minlength=len(rows)).tolist()
        ignored = np.bincount(part.frame_rows[~part.positive], minlength=len(rows)).tolist()
        names = [f"{number:06d}" for number in range(self.count, self.count + len(rows))]
        splits = [split if labels else "" for labels in positive]
        self.count += len(rows)
        self._index.writerows(
            zip(
                names, [part.dataset] * len(rows), [part.sequence] * len(rows),
                frames["frame"].to_pylist(), frames["timestamp_ns"].to_pylist(), splits, positive,
                ignored, strict=True,
            )
        )  # fmt: skip
        for name, of_frame in zip(names, splits, strict=True):
            for list_name in _SPLITS[of_frame]:
                self._lists[list_name].write(name + "\n")
        return names, splits


@contextmanager
def numbered_frames(
    folder: Path, options: ExportOptions, files: tuple[str, ...]
) -> Iterator[NumberedFrames]:
    """Open `frames.csv` and `ImageSets/` of an export; removes what a former export left there.

    Args:
        folder: of the export.
        options: name the sequences of the validation split.
        files: where a frame's files are, with `{}` for its name: those that `frames.csv` of a
            former export names are removed, and no others.

    """
    _remove_former(folder, files)
    sets = folder / "ImageSets"
    sets.mkdir(exist_ok=True)
    with ExitStack() as stack:
        index = stack.enter_context((folder / INDEX).open("w", encoding="utf-8"))
        lists = {
            name: stack.enter_context((sets / f"{name}.txt").open("w", encoding="ascii"))
            for name in ("train", "val", "trainval")
        }
        yield NumberedFrames(index, lists, frozenset(options.validation))


SPLIT_LINES = (
    ("frames", f"{INDEX} says which sequence and frame each number is"),
    (
        "splits",
        "ImageSets/train.txt and val.txt (sequences of --validation): frames with a label; "
        "the others may hold objects that nothing found",
    ),
)
"""The lines of the card about numbers and splits."""


def _remove_former(folder: Path, files: tuple[str, ...]) -> None:
    try:
        with (folder / INDEX).open(encoding="utf-8", newline="") as file:
            names = [row["name"] for row in csv.DictReader(file) if row["name"].isdigit()]
    except FileNotFoundError:
        return
    for name in names:
        for pattern in files:
            (folder / pattern.format(name)).unlink(missing_ok=True)
