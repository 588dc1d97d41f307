"""COCO instances: `annotations/instances.json` with 2D boxes and masks, beside `images/`.

Fields as on cocodataset.org (data format, object detection): `bbox` is left, top, width, height in
pixels; a mask is a compressed run-length string; `iscrowd` 1 marks a region in which detections
count neither way.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from pycocotools import mask as run_lengths

from tcrdata.exporters.cameras import image_boxes, pictured, unseen_line
from tcrdata.exporters.frame_images import FrameImages, image_line
from tcrdata.exporters.json_arrays import JsonArray
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.masks import label_masks
from tcrdata.exporters.refusals import check_images, check_name, check_shown
from tcrdata.store import Store
from tcrdata.store.table_arrays import columns
from tcrdata.types import BoolArray, FloatArray, IntArray

_DECIMALS = 6
_CATEGORY = 1
_PLAIN = ("proposal_id", "track_id", "score", "state")


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write the labels of a selection that an image shows; images without labels are listed too.

    Args:
        store: holds the selection; its dataset's images must still be where the build read them.
        selection_id: of the labels.
        out: folder that gets `annotations/instances.json` and `images/<sequence>/`.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, no positive label, or no image.
        FrameError: an image or a sweep is gone since the build.
    """
    options = options or ExportOptions()
    with chosen_labels(store, selection_id, options) as chosen:
        check_images("coco", chosen)
        check_shown("coco", chosen, pictured)
        folder = open_folder(out, options.overwrite)
        (folder / "annotations").mkdir(exist_ok=True)
        target = folder / "annotations" / "instances.json"
        with (
            target.open("w", encoding="utf-8") as file,
            tempfile.TemporaryFile("w+", encoding="utf-8", dir=folder) as aside,
        ):
            images = None if options.labels_only else folder / "images"
            instances = _Instances(images, file, aside)
            instances.write(chosen, options.category)
    return _card(str(out), options, instances, chosen)


class _Instances:
    """Writes the file: images as they come, annotations aside until all images are listed."""

    def __init__(self, images: Path | None, file: IO[str], aside: IO[str]) -> None:
        self._folder, self._file, self._aside = images, file, aside
        self.images, self.annotations = JsonArray(file), JsonArray(aside)
        self.positive = 0

    def write(self, chosen: ChosenLabels, category: str) -> None:
        """Write every sequence."""
        owners: dict[str, str] = {}
        self._file.write('{"images": ')
        with_points = {"with_points": self._folder is not None}
        for part in chosen.sequences("exported_masks", with_points):
            check_name(owners, part)
            self._add(part)
        self.images.close()
        self.annotations.close()
        names = [{"id": _CATEGORY, "name": category, "supercategory": "object"}]
        self._file.write(f', "categories": {json.dumps(names)}, "annotations": ')
        self._aside.seek(0)
        shutil.copyfileobj(self._aside, self._file)
        self._file.write("}\n")

    def _add(self, part: SequenceLabels) -> None:
        files = FrameImages(part)
        seen = np.array([files.has_image(row) for row in range(part.frames.num_rows)], dtype=bool)
        image_ids = self.images.count + np.cumsum(seen)
        self.images.extend(_images(part, files, seen, image_ids))
        if self._folder is not None:
            files.place_all(self._folder)
        boxes = image_boxes(part)
        kept = ~np.isnan(boxes).any(axis=1) & seen[part.frame_rows]
        masks = label_masks(part, kept)
        self.positive += int((kept & part.positive).sum())
        first = self.annotations.count + 1
        self.annotations.extend(_annotations(part, boxes, kept, image_ids, masks, first))


def _images(
    part: SequenceLabels, files: FrameImages, seen: BoolArray, image_ids: IntArray
) -> Iterator[dict[str, Any]]:
    names = ("frame", "width_px", "height_px", "timestamp_ns")
    rows = zip(*(part.frames[name].to_pylist() for name in names), strict=True)
    for row, (frame, width, height, timestamp) in enumerate(rows):
        if seen[row]:
            yield {
                "id": int(image_ids[row]),
                "file_name": f"images/{files.name(row)}",
                "width": width,
                "height": height,
                "dataset": part.dataset,
                "sequence": part.sequence,
                "frame": frame,
                "timestamp_ns": timestamp,
            }


def _annotations(
    part: SequenceLabels,
    boxes: FloatArray,
    kept: BoolArray,
    image_ids: IntArray,
    masks: dict[str, str],
    first: int,
) -> Iterator[dict[str, Any]]:
    size = columns(part.frames, ("height_px", "width_px"))[part.frame_rows]
    corner, extent = boxes[:, :2], boxes[:, 2:] - boxes[:, :2]
    placed = np.round(np.hstack([corner, extent]), _DECIMALS)
    plain = {name: part.labels[name].to_pylist() for name in _PLAIN}
    for number, row in enumerate(np.flatnonzero(kept).tolist()):
        box = placed[row].tolist()
        positive = plain["state"][row] == "positive"
        annotation = {
            "id": first + number,
            "image_id": int(image_ids[part.frame_rows[row]]),
            "category_id": _CATEGORY,
            "bbox": box,
            "area": round(box[2] * box[3], _DECIMALS),
            "iscrowd": 0 if positive else 1,
            "score": plain["score"][row],
            "track_id": plain["track_id"][row],
            "proposal_id": plain["proposal_id"][row],
        }
        pixels = masks.get(plain["proposal_id"][row])
        if pixels is not None or not positive:
            annotation |= _segmentation(pixels, size[row].astype(int).tolist(), box)
        yield annotation


def _segmentation(pixels: str | None, size: list[int], box: list[float]) -> dict[str, Any]:
    """Return mask and area; a crowd must have a mask, so that of its box where it has no other."""
    if pixels is None:
        (made,) = run_lengths.frPyObjects(np.array([box]), *size)
        pixels = made["counts"].decode("ascii")
    mask = {"size": size, "counts": pixels}
    return {"segmentation": mask, "area": float(run_lengths.area(mask))}


def _card(out: str, options: ExportOptions, instances: _Instances, chosen: ChosenLabels) -> Card:
    written = instances.annotations.count
    ignored = written - instances.positive
    pixels = "of the proposal's region"
    if not options.labels_only:
        pixels += ", else the convex hull of the label's points in the image"
    regions = "iscrowd 1, with a run-length mask (the box's where there is no other)"
    conventions = (
        ("file", "annotations/instances.json; file_name is relative to the folder"),
        ("images", image_line(options) + "; those without labels are listed too"),
        ("frame", "the image: x right, y down; the top left pixel's centre is 0, 0"),
        ("centre", "none: bbox starts at the left and top"),
        ("order", "bbox is left, top, width, height"),
        ("yaw", "none: boxes stand upright in the image"),
        ("units", "pixels; area in square pixels, of the mask where there is one"),
        ("masks", f"compressed run-length strings: {pixels}; labels without have no segmentation"),
        ("category", f"{_CATEGORY} = {options.category} for every object: labels have no class"),
        ("ignore", regions if options.ignore == "keep" else "dropped"),
        ("left out", unseen_line(chosen, instances.positive, ignored)),
    )
    files = 1 if options.labels_only else 1 + instances.images.count
    return Card("coco", out, files, instances.positive, ignored, conventions)
