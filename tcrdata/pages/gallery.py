"""The examples of a report with their pictures, frame by frame: one is held at a time."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from tcrdata import registry
from tcrdata.errors import TcrdataError
from tcrdata.geometry.boxes import bev_iou
from tcrdata.ingest import frames_of
from tcrdata.pages.reading import Reading
from tcrdata.pictures import read_votes
from tcrdata.types import BOX_COLUMNS, Dataset, FloatArray, Frame, ImageArray, IntArray, PointCloud
from tcrdata.views.birds_eye import vote_classes
from tcrdata.views.report.cards import BOX_KINDS, Card
from tcrdata.views.report.crops import Scene, above, missing, photo

Row = Mapping[str, Any]
_DRIVE = itemgetter("dataset", "sequence")
_FRAME = itemgetter("dataset", "sequence", "frame")
_LONGEST_REASON = 160


@dataclass(frozen=True)
class _Shot:
    """What could be read of a frame; where something could not, why."""

    frame: Frame | None
    image: ImageArray | None
    points: PointCloud | None
    classes: IntArray | None
    image_missing: str
    points_missing: str


def gallery(reading: Reading, sizes: Mapping[str, int] | None = None) -> dict[str, list[Card]]:
    """Return kind of example to its cards, both in the order of `report_gallery`.

    Args:
        reading: the selection.
        sizes: parameters of `report_gallery` to replace: how many of each kind.
    """
    rows = reading.selected("report_gallery", **(sizes or {}))
    if not rows:
        return {}
    shown = [row["proposal_id"] for row in rows]
    verdicts: dict[str, list[Row]] = defaultdict(list)
    for verdict in reading.selected("report_gallery_checks", shown_proposals=shown):
        verdicts[verdict["proposal_id"]].append(verdict)
    others: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for other in reading.selected("report_surroundings", shown_proposals=shown):
        others[_FRAME(other)].append(other)
    drawn = {
        (row["kind"], row["proposal_id"]): Card(row, verdicts[row["proposal_id"]], *pictures)
        for row, pictures in _drawn(reading, rows, others)
    }
    groups: dict[str, list[Card]] = {}
    for row in rows:
        groups.setdefault(row["kind"], []).append(drawn[row["kind"], row["proposal_id"]])
    return groups


def _drawn(
    reading: Reading, rows: Sequence[Row], others: Mapping[tuple[Any, ...], list[Row]]
) -> Iterator[tuple[Row, tuple[str, str, str]]]:
    """Yield each row with its two pictures and what ground truth says, drive by drive."""
    roots = {_DRIVE(row): row["root"] for row in reading.store.read("sequences").to_pylist()}
    ordered = sorted(rows, key=_FRAME)
    for drive, of_drive in itertools.groupby(ordered, key=_DRIVE):
        listed = list(of_drive)
        dataset, problem = _dataset(drive[0], roots.get(drive, ""))
        wanted = {row["frame"] for row in listed}
        frames = {f.frame: f for f in frames_of(reading.store, *drive) if f.frame in wanted}
        for key, of_frame in itertools.groupby(listed, key=_FRAME):
            shot = _shot(reading, dataset, problem, frames.get(key[2]))
            for row in of_frame:
                yield row, _pictures(row, shot, others.get(key, []))


def _dataset(name: str, root: str) -> tuple[Dataset | None, str]:
    """Open a dataset where its build found it; else say why not."""
    try:
        opened: Dataset = registry.find("datasets", name).open_dataset(root)
    except TcrdataError as error:
        return None, _short(error)
    return opened, ""


def _shot(reading: Reading, dataset: Dataset | None, problem: str, frame: Frame | None) -> _Shot:
    """Read a frame's image, points and votes."""
    if dataset is None or frame is None:
        reason = problem or "the store no longer lists this frame as usable"
        return _Shot(frame, None, None, None, f"No image: {reason}", f"No points: {reason}")
    image, points, classes = None, None, None
    image_missing = points_missing = ""
    if frame.has_image:
        try:
            image = dataset.read_image(frame)
        except TcrdataError as error:
            image_missing = f"No image: {_short(error)}"
    else:
        image_missing = f"No image: {frame.image_error or 'this drive has none'}"
    try:
        points = dataset.read_points(frame)
        votes = read_votes(reading.store, frame)
        classes = vote_classes(votes, len(points))
    except TcrdataError as error:
        points_missing = f"No points: {_short(error)}"
    return _Shot(frame, image, points, classes, image_missing, points_missing)


def _short(error: Exception) -> str:
    """A message in one line of bounded length."""
    message = " ".join(str(error).split())
    return message if len(message) <= _LONGEST_REASON else message[: _LONGEST_REASON - 1] + "…"


def _pictures(row: Row, shot: _Shot, others: Sequence[Row]) -> tuple[str, str, str]:
    """HTML of the two pictures and the words of ground truth."""
    box = _boxes([row])[0]
    around = {
        kind: _boxes(
            [o for o in others if o["kind"] == kind and o["object_id"] != row["proposal_id"]]
        )
        for kind in ("ignored", "labels", "truth")
    }
    projection = shot.frame.level_projection if shot.frame else None
    scene = Scene(box, BOX_KINDS[row["kind"]], around, projection, row["metric_scale"])
    truth = _truth(row, box, [other for other in others if other["kind"] == "truth"])
    camera, outside = "", "Outside the camera's view"
    if shot.image is None:
        camera = missing(shot.image_missing)
    elif projection is not None:
        camera = photo(shot.image, scene) or ""
    if shot.points is None or shot.classes is None:
        # One reason for both pictures is told once.
        seen = "" if shot.image is None else missing(shot.points_missing)
        return camera or missing(outside), seen, truth
    return camera, above(shot.points.xyz, shot.classes, scene, None if camera else outside), truth


def _truth(row: Row, box: FloatArray, truths: Sequence[Row]) -> str:
    """Which labelled object overlaps the box most, seen from above.

    Where the camera does not look nobody labelled, so nothing is said of what is not there.
    """
    if not truths:
        return ""
    overlap = bev_iou(box[None], _boxes(truths))[0]
    best = int(overlap.argmax())
    if overlap[best] > 0:
        return f"Ground truth: {truths[best]['category']}, overlap {overlap[best]:.2f} from above"
    return "" if row["left_px"] is None else "Ground truth: no labelled object here"


def _boxes(rows: Sequence[Row]) -> FloatArray:
    return np.array([[row[name] for name in BOX_COLUMNS] for row in rows]).reshape(-1, 7)
