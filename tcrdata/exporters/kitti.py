"""KITTI object detection: `training/{label_2,calib,image_2,velodyne}` and `ImageSets/`.

A label has 15 fields: type, truncated, occluded, alpha, left, top, right, bottom, height, width,
length, x, y, z, rotation_y. Source: the readme of KITTI's object development kit; a score would be
a 16th field, which results have and labels have not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tcrdata.exporters.cameras import has_camera, shown, unseen_line
from tcrdata.exporters.kitti_lines import (
    DONT_CARE,
    NO_BOX,
    NO_IMAGE_BOX,
    check_category,
    conventions,
    is_tilted,
    object_numbers,
)
from tcrdata.exporters.kitti_tree import (
    FILES,
    TRAINING,
    TREE_LINES,
    make_folders,
    place_images,
    place_points,
    write_calibrations,
)
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.numbered_frames import SPLIT_LINES, numbered_frames
from tcrdata.exporters.refusals import check_shown
from tcrdata.exporters.text_files import write_texts
from tcrdata.store import Store
from tcrdata.store.table_arrays import columns
from tcrdata.types import BoolArray

_SEATED = "Person_sitting"
_FILES = tuple(f"{TRAINING}/{name}" for name in (*FILES, "label_2/{}.txt"))


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write a selection's labels as KITTI's training set, with calibration, images and points.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets `training/`, `ImageSets/` and `frames.csv`.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or the category is none of KITTI's.
        QueryError: the condition of `where` is none.
        SettingsError: `validation` names a sequence that is none.
        MissingEvidenceError: there is no such selection, or no positive label that an image shows.
        FrameError: an image or sweep of the dataset is gone.
    """
    options = options or ExportOptions()
    check_category(options.category, _SEATED)
    counts = _Counts()
    with chosen_labels(store, selection_id, options, splits=True) as chosen:
        check_shown("kitti", chosen, _written)
        folder = open_folder(out, options.overwrite)
        training = make_folders(folder, ("label_2", "calib", "image_2", "velodyne"))
        with numbered_frames(folder, options, _FILES) as numbered:
            for found in chosen.sequences(files=not options.labels_only):
                part = found.only(_written(found))
                names, _ = numbered.add(part)
                _write_labels(training, part, names, options.category)
                write_calibrations(training, part, names)
                if not options.labels_only:
                    place_images(training, part, names)
                    place_points(training, part, names)
                counts.add(part)
    return _card(str(out), options, counts, chosen)


@dataclass
class _Counts:
    """What was written so far."""

    frames: int = 0
    labels: int = 0
    ignored: int = 0
    tilted: bool = False

    def add(self, part: SequenceLabels) -> None:
        """Count a sequence."""
        positive = int(part.positive.sum())
        self.frames += part.frames.num_rows
        self.labels += positive
        self.ignored += part.labels.num_rows - positive
        self.tilted |= is_tilted(part)


def _written(part: SequenceLabels) -> BoolArray:
    """Return (N,) which labels the format holds: what the image shows, all without a camera."""
    return shown(part) | (part.positive & ~has_camera(part))


def _write_labels(training: Path, part: SequenceLabels, names: list[str], category: str) -> None:
    """Write the file of every frame, empty ones too."""
    lines = _lines(part, category)
    texts = ((f"{names[row]}.txt", "".join(lines[labels])) for row, labels in part.by_frame())
    write_texts(training / "label_2", texts)


def _lines(part: SequenceLabels, category: str) -> list[str]:
    numbers = np.nan_to_num(object_numbers(part), nan=NO_IMAGE_BOX).tolist()
    truncated = np.nan_to_num(columns(part.labels, ("truncated_share",))[:, 0]).tolist()
    occluded = part.labels["occlusion"].to_pylist()
    positive = part.positive.tolist()
    lines = []
    for row, values in enumerate(numbers):
        texts = [f"{value:.6f}" for value in values]
        if positive[row]:
            first = f"{category} {truncated[row]:.2f} {occluded[row]} "
            lines.append(first + " ".join(texts) + "\n")
        else:
            lines.append(f"{DONT_CARE} {' '.join(texts[1:5])} {NO_BOX}\n")
    return lines


def _card(out: str, options: ExportOptions, counts: _Counts, chosen: ChosenLabels) -> Card:
    unseen = unseen_line(chosen, counts.labels, counts.ignored)
    own = (
        ("file", "training/label_2/<number>.txt, 15 fields a line: no score, as KITTI's labels"),
        *conventions(options.category, counts.tilted),
        ("truncated", "0 to 1, the share of the 2D box outside the image; occluded 0 to 3"),
        ("ignore", "DontCare: a 2D box alone" if options.ignore == "keep" else "dropped"),
        ("left out", f"{unseen}: KITTI labels what images show"),
        *TREE_LINES,
        *SPLIT_LINES,
    )
    return Card("kitti", out, counts.frames, counts.labels, counts.ignored, own)
