"""YOLO: `labels/<sequence>/<frame>.txt` beside `images/<sequence>/<frame>.png`, and `data.yaml`.

A line an object: class, then centre x, centre y, width and height as shares of the image. Readers
find the labels of an image by putting `labels` for `images` in its path. Source: the detection
dataset format in Ultralytics' documentation (docs.ultralytics.com/datasets/detect).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tcrdata.exporters.cameras import image_boxes, pictured, unseen_line
from tcrdata.exporters.frame_images import FrameImages, image_line
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.refusals import check_images, check_name, check_shown
from tcrdata.exporters.text_files import write_texts
from tcrdata.store import Store
from tcrdata.store.table_arrays import columns
from tcrdata.types import BoolArray

_CLASS = 0
_TRAIN, _VALIDATION = "train.txt", "val.txt"


@dataclass
class _Counts:
    """What was written so far."""

    images: int = 0
    positive: int = 0
    ignored: int = 0
    ignore_files: int = 0


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write the labels of a selection that an image shows; an empty file for an image without.

    Args:
        store: holds the selection; its dataset's images must still be where the build read them.
        selection_id: of the labels.
        out: folder that gets `data.yaml`, `train.txt`, `val.txt`, `images/`, `labels/` and, where
            there are undecided labels, `ignore/`.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        SettingsError: `validation` names a sequence that is none.
        MissingEvidenceError: there is no such selection, no positive label, or no image.
        FrameError: an image is gone since the build.
    """
    options = options or ExportOptions()
    counts = _Counts()
    owners: dict[str, str] = {}
    with chosen_labels(store, selection_id, options, splits=True) as chosen:
        check_images("yolo", chosen)
        check_shown("yolo", chosen, pictured)
        folder = open_folder(out, options.overwrite)
        with (
            (folder / _TRAIN).open("w", encoding="utf-8") as train,
            (folder / _VALIDATION).open("w", encoding="utf-8") as validation,
        ):
            for part in chosen.sequences():
                check_name(owners, part)
                listing = validation if part.sequence in options.validation else train
                names = _write(folder, part, counts)
                if not options.labels_only:
                    FrameImages(part).place_all(folder / "images")
                listing.writelines(f"./images/{name}\n" for name in names)
        (folder / "data.yaml").write_text(_data_yaml(options), encoding="utf-8")
    return _card(str(out), options, counts, chosen)


def _write(folder: Path, part: SequenceLabels, counts: _Counts) -> list[str]:
    """Write one sequence; returns the names of its images."""
    files = FrameImages(part)
    (folder / "labels" / part.sequence).mkdir(parents=True, exist_ok=True)
    lines, shown = _lines(part)
    positive = part.positive
    names, texts, ignored = [], [], []
    for row, labels in part.by_frame():
        if not files.has_image(row):
            continue
        names.append(files.name(row))
        text = Path(files.name(row)).with_suffix(".txt").name
        own = np.arange(labels.start, labels.stop)[shown[labels]]
        kept, undecided = own[positive[own]], own[~positive[own]]
        texts.append((text, "".join([lines[n] for n in kept])))
        if len(undecided):
            ignored.append((text, "".join([lines[n] for n in undecided])))
        counts.positive += len(kept)
        counts.ignored += len(undecided)
    write_texts(folder / "labels" / part.sequence, texts)
    _write_ignored(folder / "ignore" / part.sequence, [text for text, _ in texts], ignored)
    counts.images += len(names)
    counts.ignore_files += len(ignored)
    return names


def _write_ignored(folder: Path, frames: list[str], texts: list[tuple[str, str]]) -> None:
    """Write the undecided labels of a sequence; those of a former export's frames go."""
    if folder.is_dir():
        for name in frames:
            (folder / name).unlink(missing_ok=True)
    if texts:
        folder.mkdir(parents=True, exist_ok=True)
        write_texts(folder, texts)


def _lines(part: SequenceLabels) -> tuple[list[str], BoolArray]:
    """Return the line of every label, and which labels an image shows."""
    boxes = image_boxes(part)
    size = columns(part.frames, ("width_px", "height_px"))[part.frame_rows]
    low, high = boxes[:, :2], boxes[:, 2:]
    shares = np.hstack([(low + high) / 2 / size, (high - low) / size])
    lines = [f"{_CLASS} {x:.8f} {y:.8f} {w:.8f} {h:.8f}\n" for x, y, w, h in shares.tolist()]
    return lines, np.asarray(~np.isnan(boxes).any(axis=1))


def _data_yaml(options: ExportOptions) -> str:
    # JSON's strings are YAML's too. Without `path`, the folder of this file counts.
    validation = _VALIDATION if options.validation else _TRAIN
    return (
        f"train: {_TRAIN}\nval: {validation}\nnames:\n  {_CLASS}: {json.dumps(options.category)}\n"
    )


def _card(out: str, options: ExportOptions, counts: _Counts, chosen: ChosenLabels) -> Card:
    side = "the format has none: they stand in ignore/, as labels do in labels/; mask them yourself"
    split = f"{_VALIDATION} lists the sequences of --validation, {_TRAIN} the others"
    if not options.validation:
        split = f"none, for want of --validation: train and val of data.yaml are both {_TRAIN}"
    conventions = (
        ("file", "labels/<sequence>/<frame>.txt: class, centre x, centre y, width, height"),
        ("images", image_line(options) + "; one without labels has an empty file"),
        ("split", split),
        ("frame", "the image: x right, y down; the top left pixel's centre is 0, 0"),
        ("centre", "centre of the 2D box"),
        ("order", "x y width height"),
        ("yaw", "none: boxes stand upright in the image"),
        ("units", "shares of the image's width and height, 0 to 1"),
        ("class", f"{_CLASS} = {options.category} for every object: the labels have no class"),
        ("ignore", side if options.ignore == "keep" else "dropped"),
        ("left out", unseen_line(chosen, counts.positive, counts.ignored)),
    )
    files = counts.images * (1 if options.labels_only else 2) + counts.ignore_files + 3
    return Card("yolo", out, files, counts.positive, counts.ignored, conventions)
