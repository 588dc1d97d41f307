"""KITTI tracking results: `label_02/<sequence>.txt`, one object a line, the score last.

Fields: frame, track, type, truncated, occluded, alpha, left, top, right, bottom, height, width,
length, x, y, z, rotation_y, score. Source: the readme of KITTI's tracking development kit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcrdata.exporters.cameras import shown
from tcrdata.exporters.kitti_lines import (
    DONT_CARE,
    NO_BOX,
    NO_IMAGE_BOX,
    check_category,
    conventions,
    is_tilted,
    object_numbers,
)
from tcrdata.exporters.labels import (
    Card,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.refusals import check_name
from tcrdata.store import Store
from tcrdata.store.table_arrays import columns

_NO_TRACK = -1
_SEATED = "Person"


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write a selection's labels, one file for every sequence, empty ones too.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets `label_02/`; in one that is not empty, `overwrite` replaces the
            files of these sequences alone: others may be somebody's ground truth.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, the category is none of KITTI's, or two datasets
            have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, or it has no positive labels.
    """
    options = options or ExportOptions()
    check_category(options.category, _SEATED)
    owners: dict[str, str] = {}
    ignored, tilted = 0, False
    with chosen_labels(store, selection_id, options) as chosen:
        folder = open_folder(out, options.overwrite) / "label_02"
        folder.mkdir(exist_ok=True)
        for found in chosen.sequences(files=False):
            check_name(owners, found)
            part = found.only(found.positive | shown(found))
            lines = _lines(part, options.category)
            (folder / f"{part.sequence}.txt").write_text("".join(lines), encoding="ascii")
            ignored += len(lines) - int(part.positive.sum())
            tilted |= is_tilted(part)
    shared = conventions(options.category, tilted)
    kept = "DontCare of track -1 with a 2D box alone; those no image shows are left out"
    own = (
        ("file", "label_02/<sequence>.txt, 18 fields a line, the score last"),
        *shared,
        ("truncated", "0 to 2; occluded 0 to 3, where 3 is unknown"),
        ("track", "whole numbers from 0 in each sequence"),
        ("ignore", kept if options.ignore == "keep" else "dropped"),
    )
    return Card("kitti-tracking", str(out), len(owners), chosen.total, ignored, own)


def _lines(part: SequenceLabels, category: str) -> list[str]:
    numbers = np.nan_to_num(object_numbers(part), nan=NO_IMAGE_BOX)
    numbers = np.column_stack([numbers, columns(part.labels, ("score",))])
    names = ("frame", "track_number", "truncation", "occlusion")
    whole = zip(*(part.labels[name].to_pylist() for name in names), strict=True)
    return [
        _line(frame, track, f"{category} {truncated} {occluded}", row)
        for (frame, track, truncated, occluded), row in zip(whole, numbers.tolist(), strict=True)
    ]


def _line(frame: int, track: int | None, what: str, numbers: list[float]) -> str:
    """Return one line; without a track it is an ignore region."""
    if track is None:
        box = " ".join([f"{value:.6f}" for value in numbers[1:5]])
        return f"{frame} {_NO_TRACK} {DONT_CARE} {box} {NO_BOX} -1\n"
    return f"{frame} {track} {what} " + " ".join([f"{value:.6f}" for value in numbers]) + "\n"
