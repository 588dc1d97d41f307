"""A frame and its objects as one record: what formats of samples hold beside the image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import pyarrow as pa

from tcrdata.exporters.frame_images import EncodedImage, FrameImages
from tcrdata.exporters.labels import ChosenLabels, ExportOptions, SequenceLabels
from tcrdata.exporters.refusals import check_name

T = TypeVar("T")

FRAME = {
    "dataset": pa.string(),
    "sequence": pa.string(),
    "frame": pa.int64(),
    "timestamp_ns": pa.int64(),
    "width_px": pa.int64(),
    "height_px": pa.int64(),
    "projection": pa.list_(pa.float64()),
    "camera_T_level": pa.list_(pa.float64()),
    "level_T_sensor": pa.list_(pa.float64()),
}
"""The columns of a frame, as `frames` has them: matrices row-major."""

OBJECT = {
    "state": pa.string(),
    "category": pa.string(),
    "score": pa.float64(),
    "track_id": pa.string(),
    "proposal_id": pa.string(),
    "box_3d": pa.list_(pa.float64()),
    "box_2d": pa.list_(pa.float64()),
    "number_of_points": pa.int64(),
    "speed_mps": pa.float64(),
}
"""The columns of an object: box_3d is x, y, z, length, width, height, yaw; box_2d left, top, right,
bottom, NULL where no image shows it."""

_BOX_2D = ("left_px", "top_px", "right_px", "bottom_px")
_PLAIN = ("state", "score", "track_id", "proposal_id", "number_of_points", "speed_mps")


def records(part: SequenceLabels, category: str) -> Iterator[dict[str, Any]]:
    """Yield a record a frame, frames without objects too: the keys of FRAME, then `objects`.

    Args:
        part: a sequence.
        category: of every object.
    """
    objects = _objects(part, category)
    frames = part.frames.select(list(FRAME)).to_pylist()
    for row, labels in part.by_frame():
        yield {**frames[row], "objects": objects[labels]}


def named_sequences(chosen: ChosenLabels) -> Iterator[SequenceLabels]:
    """Yield the sequences of an export whose samples are named for them.

    Raises:
        SettingsError: two datasets have a sequence of one name.
    """
    owners: dict[str, str] = {}
    for part in chosen.sequences():
        check_name(owners, part)
        yield part


def pictured_records(
    part: SequenceLabels, options: ExportOptions
) -> Iterator[tuple[dict[str, Any], EncodedImage | None]]:
    """Yield each frame's record and its image's bytes; None without one, or where none is wanted.

    Raises:
        FrameError: an image is gone since the build.
    """
    files = FrameImages(part)
    for row, record in enumerate(records(part, options.category)):
        wanted = files.has_image(row) and not options.labels_only
        yield record, files.encoded(row) if wanted else None


def runs_of(items: Iterator[T], size: Callable[[T], int], limit: int) -> Iterator[Iterator[T]]:
    """Share items out to files: yield runs of them whose sizes stay within a limit together.

    An item larger than that is a run of its own. Each run is to be used up before the next.

    Args:
        items: not None.
        size: of an item, bytes.
        limit: bytes of a file.
    """
    waiting = next(items, None)

    def run() -> Iterator[T]:
        nonlocal waiting
        left = limit
        while waiting is not None:
            item = waiting
            yield item
            left -= size(item)
            waiting = next(items, None)
            if waiting is not None and size(waiting) > left:
                return

    while waiting is not None:
        yield run()


def conventions(options: ExportOptions) -> tuple[tuple[str, str], ...]:
    """Return the lines of a card that say how to read such a record."""
    kept = 'objects whose state is "ignore": leave these regions out of the loss'
    return (
        (
            "frame",
            "level frame of each frame: x right, y down along gravity, z forward, from the camera",
        ),
        ("centre", "geometric centre of the box"),
        ("order", "box_3d is x y z length width height yaw; box_2d is left top right bottom"),
        ("yaw", "about y (down): the heading is (cos yaw, 0, -sin yaw); 0 along +x, -pi/2 forward"),
        ("units", "metres, radians, pixels, nanoseconds"),
        ("matrices", "row-major: projection 3x4 (camera to pixels), a_T_b 4x4 (points of b to a)"),
        ("category", f"{options.category} for every object: the labels have no class"),
        ("ignore", kept if options.ignore == "keep" else "dropped"),
    )


def _objects(part: SequenceLabels, category: str) -> list[dict[str, Any]]:
    plain = {name: part.labels[name].to_pylist() for name in _PLAIN}
    flat = (part.labels[name].to_pylist() for name in _BOX_2D)
    boxes_2d = [None if None in box else list(box) for box in zip(*flat, strict=True)]
    boxes_3d = part.boxes.tolist()
    return [
        {
            "state": plain["state"][row],
            "category": category,
            "score": plain["score"][row],
            "track_id": plain["track_id"][row],
            "proposal_id": plain["proposal_id"][row],
            "box_3d": boxes_3d[row],
            "box_2d": boxes_2d[row],
            "number_of_points": plain["number_of_points"][row],
            "speed_mps": plain["speed_mps"][row],
        }
        for row in range(len(boxes_3d))
    ]
