"""OpenPCDet's custom dataset: points, labels, splits and the infos that its loader reads.

`points/<number>.npy` is (N, 4) float32 x, y, z, intensity; a line of `labels/<number>.txt` is
`x y z dx dy dz heading category`; `custom_infos_<split>.pkl` is a list with `point_cloud` and
`annos` of every frame. Source: OpenPCDet's CUSTOM_DATASET_TUTORIAL.md and custom_dataset.py.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.errors import TcrdataError
from tcrdata.exporters.frame_points import FramePoints, lidar_boxes, lidar_poses
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.numbered_frames import SPLIT_LINES, numbered_frames
from tcrdata.exporters.text_files import write_texts
from tcrdata.store import Store
from tcrdata.types import FloatArray

_FOLDERS = ("points", "labels", "ignored")
_FILES = ("points/{}.npy", "labels/{}.txt", "ignored/{}.txt")
_IGNORED = "DontCare"
_FEATURES = 4

_CONVENTIONS = (
    ("frame", "LiDAR: x forward, y left, z up (of a depth camera: at the camera, level)"),
    ("centre", "geometric centre of the box"),
    ("order", "x y z, then dx (length), dy (width), dz (height), heading, category"),
    ("yaw", "heading about z (up): 0 along +x (forward), pi/2 along +y; KITTI's -(pi/2 + ry)"),
    ("units", "metres, radians; intensity 0 to 1"),
    ("config", "point_features x y z intensity; DATA_SPLIT train and val"),
    (
        "next",
        "gt_sampling wants gt_database/: OpenPCDet's create_groundtruth_database() makes it",
    ),
)


class _PlainArray(np.ndarray[Any, Any]):
    """An array that pickles by value: numpy's own pickles name modules that numpy 1 has not."""

    def __reduce__(self) -> Any:
        if not self.size:
            return np.zeros, (self.shape, self.dtype.str)
        return np.array, (self.tolist(), self.dtype.str)


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write a selection's labels as a custom dataset of OpenPCDet.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets `points/`, `labels/`, `ignored/`, `ImageSets/`, the infos and
            `frames.csv`.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or the category is no single word.
        QueryError: the condition of `where` is none.
        SettingsError: `validation` names a sequence that is none.
        MissingEvidenceError: there is no such selection, or it has no positive labels.
        FrameError: the points of a frame are gone.
    """
    options = options or ExportOptions()
    _check_category(options.category)
    infos: dict[str, list[dict[str, Any]]] = {"train": [], "val": []}
    with chosen_labels(store, selection_id, options, splits=True) as chosen:
        folder = open_folder(out, options.overwrite)
        for name in _FOLDERS:
            (folder / name).mkdir(exist_ok=True)
        with numbered_frames(folder, options, _FILES) as numbered:
            for part in chosen.sequences(files=False):
                names, splits = numbered.add(part)
                boxes = lidar_boxes(part.boxes, lidar_poses(part)[part.frame_rows])
                _write_labels(folder, part, boxes, names, options.category)
                for row, labels in part.by_frame():
                    if splits[row]:
                        own = boxes[labels][part.positive[labels]]
                        infos[splits[row]].append(_info(names[row], own, options.category))
                if not options.labels_only:
                    _write_points(folder, part, names)
    for split, of_split in infos.items():
        (folder / f"custom_infos_{split}.pkl").write_bytes(pickle.dumps(of_split, protocol=4))
    return _card(str(out), options, chosen, numbered.count)


def _check_category(category: str) -> None:
    """Refuse a category that its reader would split, or drop."""
    if category.split() != [category] or category == _IGNORED:
        raise TcrdataError(
            f"OpenPCDet cannot read the category '{category}': give one word, not {_IGNORED}"
        )


def _write_labels(
    folder: Path, part: SequenceLabels, boxes: FloatArray, names: list[str], category: str
) -> None:
    """Write the labels of every frame, empty files too, and its ignore regions where it has any."""
    lines = [" ".join([f"{value:.6f}" for value in box]) for box in boxes.tolist()]
    positive = part.positive.tolist()
    texts, ignored = [], []
    for row, labels in part.by_frame():
        file = f"{names[row]}.txt"
        of_frame = list(zip(lines[labels], positive[labels], strict=True))
        texts.append((file, "".join(f"{line} {category}\n" for line, kept in of_frame if kept)))
        if undecided := "".join(f"{line} {_IGNORED}\n" for line, kept in of_frame if not kept):
            ignored.append((file, undecided))
    write_texts(folder / "labels", texts)
    write_texts(folder / "ignored", ignored)


def _write_points(folder: Path, part: SequenceLabels, names: list[str]) -> None:
    points = FramePoints(part)
    for row, name in enumerate(names):
        np.save(folder / "points" / f"{name}.npy", points.read(row))


def _info(name: str, boxes: FloatArray, category: str) -> dict[str, Any]:
    """Return a frame's entry: its points, its boxes as the label file has them, their names."""
    names = np.full(len(boxes), category)
    return {
        "point_cloud": {"num_features": _FEATURES, "lidar_idx": name},
        "annos": {
            "name": names.view(_PlainArray),
            "gt_boxes_lidar": boxes.astype(np.float32).view(_PlainArray),
        },
    }


def _card(out: str, options: ExportOptions, chosen: ChosenLabels, files: int) -> Card:
    kept = (
        "the format has none: undecided labels stand in ignored/<number>.txt, which OpenPCDet "
        "does not read"
    )
    lines = (
        ("file", "labels/<number>.txt, points/<number>.npy, custom_infos_{train,val}.pkl"),
        *_CONVENTIONS,
        ("ignore", kept if options.ignore == "keep" else "dropped"),
        ("type", f"{options.category} for every object: CLASS_NAMES and MAP_CLASS_TO_KITTI"),
        *SPLIT_LINES,
    )
    return Card("openpcdet", out, files, chosen.total, chosen.ignored, lines)
