"""KITTI's labelled objects: tracking's `label_02/*.txt` and raw's `tracklet_labels.xml`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from tcrdata.errors import DatasetError
from tcrdata.types import FloatArray

DONT_CARE = "DontCare"
_NUMBER_OF_FIELDS = 17
_FIELDS = (
    "frame track_id type truncated occluded alpha left top right bottom height width length "
    "x y z rotation_y"
)
_CATEGORIES = {"Person (sitting)": "Person"}
_OUT_OF_IMAGE = 2.0
_TRUNCATION_UNSET = 99.0
_OCCLUSION_UNKNOWN = 3.0


@dataclass(frozen=True)
class LabelledObject:
    """One object in one frame.

    Attributes:
        frame: number of the frame.
        object_id: the same in every frame.
        category: KITTI's class name.
        truncated: 0 whole, 1 cut by the image's edge, 2 mostly cut; None when not given.
        occluded: 0 visible, 1 partly, 2 largely hidden, 3 unknown.
        box: x, y, z, length, width, height (m) and yaw (rad) in the level frame, the centre the
            geometric one; None for a region that is left out of scoring.
        image_box_px: left, top, right, bottom; None when the file gives none.
    """

    frame: int
    object_id: str
    category: str
    truncated: float | None
    occluded: float
    box: tuple[float, ...] | None
    image_box_px: tuple[float, ...] | None


def read_label_file(path: Path) -> list[LabelledObject]:
    """Read the labels of a tracking sequence; empty without the file.

    Raises:
        DatasetError: the file cannot be read or a line is broken.
    """
    if not path.exists():
        return []
    lines = _read(path).decode("utf-8", errors="replace").splitlines()
    return [_parse_line(path, i, line) for i, line in enumerate(lines, 1) if line.strip()]


def _parse_line(path: Path, line_number: int, line: str) -> LabelledObject:
    words = line.split()
    try:
        if len(words) != _NUMBER_OF_FIELDS:
            raise ValueError(f"found {len(words)} fields")
        frame, track = int(words[0]), int(words[1])
        truncated, occluded, _, *image_box = (_finite(word) for word in words[3:10])
        height, width, length, x, bottom_y, z, yaw = (_finite(word) for word in words[10:])
        if frame < 0:
            raise ValueError("the frame is negative")
        if words[2] != DONT_CARE and min(height, width, length) <= 0:
            raise ValueError("height, width and length must be positive")
    except ValueError as error:
        raise DatasetError(
            f"'{path}', line {line_number}: {error}; expected {_NUMBER_OF_FIELDS} fields: {_FIELDS}"
            "; fetch the file again, or build without it"
        ) from error
    if words[2] == DONT_CARE:
        name = f"{DONT_CARE}-{line_number}"
        return LabelledObject(frame, name, DONT_CARE, None, occluded, None, tuple(image_box))
    box = (x, bottom_y - height / 2, z, length, width, height, yaw)
    return LabelledObject(frame, str(track), words[2], truncated, occluded, box, tuple(image_box))


def read_tracklets(path: Path, level_T_sensor: FloatArray) -> list[LabelledObject]:
    """Read the tracklets of a raw drive; empty without the file.

    Poses that are marked as out of the image, or whose centre lies behind the camera, are left
    out, as the tracking benchmark does. The object's id is its place in the file.

    Args:
        path: `tracklet_labels.xml`: poses in the Velodyne's frame, at the bottom of the box, yaw
            `rz` about its z axis.
        level_T_sensor: (4, 4), Velodyne to level frame.

    Raises:
        DatasetError: the file cannot be read, is not well-formed, or lacks a value.
    """
    if not path.exists():
        return []
    data = _read(path)
    # The parser would expand entities, without bound.
    if b"<!ENTITY" in data:
        raise DatasetError(f"'{path}': entities are not allowed in tracklets")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise DatasetError(
            f"'{path}' is not well-formed XML: {error}; fetch it again, or build without it"
        ) from error
    tracklets = root.findall("./tracklets/item")
    return [
        found
        for i, tracklet in enumerate(tracklets)
        for found in _poses(_Element(path, f"tracklet {i}", tracklet), str(i), level_T_sensor)
    ]


def _poses(
    tracklet: _Element, object_id: str, level_T_sensor: FloatArray
) -> Iterator[LabelledObject]:
    category = tracklet.text("objectType")
    category = _CATEGORIES.get(category, category)
    first_frame = int(tracklet.number("first_frame"))
    length, width, height = (tracklet.positive(name) for name in "lwh")
    for i, element in enumerate(tracklet.element.findall("./poses/item")):
        pose = _Element(tracklet.path, f"{tracklet.place}, pose {i}", element)
        bottom = level_T_sensor @ [*(pose.number(name) for name in ("tx", "ty", "tz")), 1.0]
        rz = pose.number("rz")
        heading = level_T_sensor[:3, :3] @ [np.cos(rz), np.sin(rz), 0.0]
        yaw = float(np.arctan2(-heading[2], heading[0]))
        truncated, occluded = pose.number("truncation"), pose.number("occlusion")
        if truncated == _OUT_OF_IMAGE or bottom[2] <= 0:
            continue
        x, y, z = (float(v) for v in bottom[:3])
        yield LabelledObject(
            frame=first_frame + i,
            object_id=object_id,
            category=category,
            truncated=None if truncated == _TRUNCATION_UNSET else truncated,
            occluded=_OCCLUSION_UNKNOWN if occluded < 0 else occluded,
            box=(x, y - height / 2, z, length, width, height, yaw),
            image_box_px=None,
        )


@dataclass(frozen=True)
class _Element:
    """An XML element that knows where it is, for messages."""

    path: Path
    place: str
    element: ElementTree.Element

    def text(self, name: str) -> str:
        """Return the text of a child."""
        text = self.element.findtext(name)
        if not text:
            raise DatasetError(f"'{self.path}', {self.place}: no <{name}>")
        return text.strip()

    def number(self, name: str) -> float:
        """Return the finite number in a child."""
        try:
            return _finite(self.text(name))
        except ValueError as error:
            raise DatasetError(f"'{self.path}', {self.place}, <{name}>: {error}") from error

    def positive(self, name: str) -> float:
        """Return the positive number in a child."""
        value = self.number(name)
        if value <= 0:
            raise DatasetError(f"'{self.path}', {self.place}, <{name}>: {value:g} is not positive")
        return value


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(f"'{word}' is not a finite number")
    return value


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DatasetError(f"cannot read the labels '{path}': {error.strerror}") from error
