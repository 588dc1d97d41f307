"""Recordings of a store's sequences: what was selected, what was not, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import tcrdata
from tcrdata import registry
from tcrdata.errors import SettingsError
from tcrdata.evidence.poses import Poses, read_poses
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.ingest import frames_of
from tcrdata.pictures import read_votes, sequence_row
from tcrdata.plan import ROUND
from tcrdata.reports import run_report
from tcrdata.store import Store
from tcrdata.types import BOX_COLUMNS, Dataset, FloatArray, Frame

if TYPE_CHECKING:
    from tcrdata.views.rerun_recording import RecordedBoxes, RecordedFrame

_ROWS_A_BATCH = 2_000


def record_sequence(
    store: Store,
    selection_id: str,
    out: Path,
    sequence: str | None,
    frames: str | None,
    *,
    with_truth: bool,
) -> Iterator[int]:
    """Write a Rerun recording of a sequence; yield each frame's number once it is written.

    The file takes its name when the last frame is in it: one that is there is complete.

    Args:
        store: what to show; its dataset must still be where the build read it.
        selection_id: whose labels to show.
        out: file to write, replaced when it is there.
        sequence: the first of the store when None.
        frames: ranges such as `0-99`; all when None.
        with_truth: show ground truth too.

    Raises:
        SettingsError: rerun is not installed, the file cannot be written, or no such frame.
        MissingEvidenceError: the store has no such sequence.
    """
    RerunRecording = _recording_class()
    info = sequence_row(store, sequence)
    chosen = _chosen(store, info, frames)
    dataset = registry.find("datasets", info["dataset"]).open_dataset(info["root"])
    shots = _shots(store, selection_id, info, dataset, chosen, with_truth=with_truth)
    part = _part_of(out)
    try:
        name = f"{info['dataset']} {info['sequence']}"
        with RerunRecording(part, name, info["metric_scale"]) as recording:
            for shot in shots:
                recording.add(shot)
                yield shot.frame
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)


def _part_of(out: Path) -> Path:
    """Make the file that grows until it is whole and takes the name asked for."""
    if out.is_dir():
        raise SettingsError(f"--out {out} is a folder: name a file, such as {out / 'view.rrd'}")
    part = out.with_name(out.name + ".part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
    except OSError as error:
        raise SettingsError(f"--out {out}: {error.strerror}: give another file") from error
    return part


def _recording_class() -> Any:
    try:
        from tcrdata.views.rerun_recording import RerunRecording
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "rerun":
            raise
        raise SettingsError(
            "a recording needs the package rerun-sdk: pip install 'tcrdata[viz]'"
        ) from error
    return RerunRecording


def _chosen(store: Store, info: dict[str, Any], text: str | None) -> list[Frame]:
    ranges = parse_frame_ranges(text)
    found = frames_of(store, info["dataset"], info["sequence"])
    chosen = [frame for frame in found if frame.frame in ranges]
    if not chosen:
        raise SettingsError(f"{info['sequence']} has no usable frame among --frames {ranges.text}")
    return chosen


def _shots(
    store: Store,
    selection_id: str,
    info: dict[str, Any],
    dataset: Dataset,
    frames: list[Frame],
    *,
    with_truth: bool,
) -> Iterator[RecordedFrame]:
    from tcrdata.views.birds_eye import vote_classes
    from tcrdata.views.rerun_recording import RecordedFrame

    poses = _poses(store, info)
    paths = _paths(poses)
    boxes = _boxes_of_frames(store, selection_id, info, frames)
    for frame, rows in _matched(frames, boxes):
        points = dataset.read_points(frame).xyz
        segment = poses.segment.get(frame.frame, -1 - frame.frame)
        yield RecordedFrame(
            frame=frame.frame,
            timestamp_ns=frame.timestamp_ns,
            world_T_level=poses.world_T_level.get(frame.frame, np.eye(4)),
            segment=segment,
            path=paths.get(segment, np.zeros((1, 3))),
            points=points,
            classes=vote_classes(read_votes(store, frame), len(points)),
            boxes=_boxes(rows, with_truth=with_truth),
            image=dataset.read_image(frame) if frame.has_image else None,
            projection=frame.camera.matrix if frame.camera else None,
            camera_T_level=np.asarray(frame.camera_T_level, dtype=np.float64),
        )


def _poses(store: Store, info: dict[str, Any]) -> Poses:
    """Egomotion that a build has chained: odometry's where there is any."""
    tables = store.tables(info["dataset"], info["sequence"], ROUND)
    poses = read_poses(tables)
    return poses if poses.segment else read_poses(tables, "flow_ransac")


def _paths(poses: Poses) -> dict[int, FloatArray]:
    """Return the positions of the sensor in each segment's world, in order."""
    by_segment = sorted((segment, frame) for frame, segment in poses.segment.items())
    return {
        segment: np.array([poses.world_T_level[frame][:3, 3] for _, frame in group])
        for segment, group in groupby(by_segment, key=itemgetter(0))
    }


def _boxes_of_frames(
    store: Store, selection_id: str, info: dict[str, Any], frames: list[Frame]
) -> Iterator[tuple[int, list[dict[str, Any]]]]:
    """Yield the boxes of each frame that has any, in order of the frames, by one query."""
    parameters = {
        "selection_id": selection_id,
        "pictured_dataset": info["dataset"],
        "pictured_sequence": info["sequence"],
        "pictured_frames": [frame.frame for frame in frames],
    }
    relation = run_report(tcrdata.open(store.url).connection, "picture_boxes", parameters)
    reader = relation.to_arrow_reader(_ROWS_A_BATCH)
    rows = (row for batch in reader for row in batch.to_pylist())
    for number, group in groupby(rows, key=itemgetter("frame")):
        yield number, list(group)


def _matched(
    frames: list[Frame], boxes: Iterator[tuple[int, list[dict[str, Any]]]]
) -> Iterator[tuple[Frame, list[dict[str, Any]]]]:
    """Pair frames with their boxes; both come in order, and a frame may have none."""
    number, rows = next(boxes, (None, []))
    for frame in frames:
        if frame.frame == number:
            yield frame, rows
            number, rows = next(boxes, (None, []))
        else:
            yield frame, []


def _boxes(rows: list[dict[str, Any]], *, with_truth: bool) -> dict[str, RecordedBoxes]:
    from tcrdata.views.rerun_recording import RecordedBoxes

    kinds = {row["kind"] for row in rows} - (set() if with_truth else {"truth"})
    found = {}
    for kind in sorted(kinds):
        own = [row for row in rows if row["kind"] == kind]
        found[kind] = RecordedBoxes(
            np.array([[row[name] for name in BOX_COLUMNS] for row in own], dtype=np.float64),
            ["/".join((row["track_id"] or "").split("/")[-2:]) for row in own],
            np.array([row["score"] for row in own], dtype=np.float64),
            np.array([row["number_of_points"] for row in own], dtype=np.float64),
        )
    return found
