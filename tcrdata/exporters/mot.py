"""MOTChallenge results: `<sequence>.txt`, one box a line, frames and tracks from 1.

Fields, with commas between: frame, track, left, top, width, height (pixels), confidence, x, y, z
(metres). Source: the format of the MOTChallenge's 3D results, Leal-Taixe et al., "MOTChallenge
2015" (2015).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcrdata.exporters.cameras import image_boxes, shown
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

_PLACE = ("x_m", "y_m", "z_m")
_CONVENTIONS = (
    ("file", "<sequence>.txt, 10 fields a line with commas between, no header"),
    ("frame", "from 1: the dataset's number plus one"),
    ("track", "whole numbers from 1 in each sequence"),
    ("box", "left, top, width, height in pixels, clipped to the image; outside of it: left out"),
    ("confidence", "of the label or the match, in [0, 1]"),
    ("place", "x, y, z of the 3D centre in metres: x right, y down, z forward of the camera"),
    ("ignore", "left out: the format has none"),
)


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write a selection's labels or tracklets, one file for every sequence, empty ones too.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets the files; in one that is not empty, `overwrite` replaces the files
            of these sequences alone.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, or it has no positive labels.
    """
    options = options or ExportOptions()
    owners: dict[str, str] = {}
    written = 0
    with chosen_labels(store, selection_id, options) as chosen:
        folder = open_folder(out, options.overwrite)
        for found in chosen.sequences(files=False):
            check_name(owners, found)
            part = found.only(found.positive & shown(found))
            lines = _lines(part)
            (folder / f"{part.sequence}.txt").write_text("".join(lines), encoding="ascii")
            written += len(lines)
    return Card("mot", str(out), len(owners), written, 0, _CONVENTIONS)


def _lines(part: SequenceLabels) -> list[str]:
    box = image_boxes(part)
    rest = columns(part.labels, ("score", *_PLACE))
    numbers = np.column_stack([box[:, :2], box[:, 2:] - box[:, :2], rest])
    frames = part.labels["frame"].to_pylist()
    tracks = part.labels["track_number"].to_pylist()
    return [
        f"{frame + 1},{track + 1}," + ",".join(f"{value:.6f}" for value in row) + "\n"
        for frame, track, row in zip(frames, tracks, numbers.tolist(), strict=True)
    ]
