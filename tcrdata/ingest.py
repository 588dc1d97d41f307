"""The first stages of a sequence: its frames, as rows, each read once; and its ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tcrdata import settings
from tcrdata.datasets.frame_counts import counted_frames
from tcrdata.errors import DatasetError
from tcrdata.evidence.chunks import chunked
from tcrdata.plan import FRAMES, ROUND, TRUTH, Plan, cue_inputs
from tcrdata.store import Store, Unit
from tcrdata.types import Camera, Dataset, Frame, Map, SequenceInfo

FRAMES_A_TASK = 16


def ingest_frames(
    store: Store, plan: Plan, dataset: Dataset, info: SequenceInfo, parallel: Map
) -> None:
    """Read every frame once and commit `sequences`, `frames`, `images` and `sweeps`.

    A frame whose points cannot be read becomes a row with status `error`; the rest goes on.

    Raises:
        DatasetError: no frame of the sequence is among those asked for.
    """
    frames = [frame for frame in dataset.frames(info.sequence) if frame.frame in plan.frames]
    if not frames:
        raise DatasetError(
            f"{info.dataset}/{info.sequence}: no frame among --frames {plan.frames.text}"
        )
    unit = Unit(FRAMES, plan.dataset_name, info.sequence, ROUND)
    inputs = frame_inputs(plan, info)
    # Without any, it is no fault of a frame to have none.
    has_images = any(frame.image_path is not None for frame in frames)
    with store.writer(unit, settings_hash=plan.settings_hash(FRAMES), inputs=inputs) as writer:
        writer.append("sequences", _sequence_columns(info, frames))
        tasks = [(dataset, chunk) for chunk in chunked(frames, FRAMES_A_TASK)]
        for checked in parallel(counted_frames, tasks):
            writer.append("frames", _frame_columns(checked))
            usable = [(frame, count) for frame, count in checked if frame.status == "ok"]
            writer.append("images", _image_columns([frame for frame, _ in usable]))
            writer.append("sweeps", _sweep_columns(usable))
            for frame, _ in checked:
                if problem := frame.error or (has_images and frame.image_error):
                    writer.error(frame.frame, str(problem))


def unit_inputs(store: Store, plan: Plan, unit: Unit, info: SequenceInfo) -> dict[str, str]:
    """Return what a unit's rows follow from besides settings: files, or other units' records."""
    return frame_inputs(plan, info) if unit.stage == FRAMES else cue_inputs(store, unit)


def frame_inputs(plan: Plan, info: SequenceInfo) -> dict[str, str]:
    """Return what the rows of `frames` follow from."""
    return {"files": info.fingerprint, "frames": plan.frames.text, "root": info.root}


def ingest_truth(store: Store, plan: Plan, dataset: Dataset, sequence: str) -> bool:
    """Commit `ground_truth`, which evaluation alone reads.

    Returns:
        Whether anything was written; False when the very rows are there already.

    Raises:
        DatasetError: a label file is broken.
    """
    rows = [row for row in dataset.ground_truth(sequence) if row["frame"] in plan.frames]
    unit = Unit(TRUTH, plan.dataset_name, sequence, ROUND)
    inputs = {"rows": settings.digest([{k: _plain(v) for k, v in row.items()} for row in rows])}
    if store.is_done(unit, plan.settings_hash(TRUTH), inputs):
        return False
    with store.writer(unit, settings_hash=plan.settings_hash(TRUTH), inputs=inputs) as writer:
        if rows:
            writer.append("ground_truth", {name: [row[name] for row in rows] for name in rows[0]})
    return True


def frames_of(store: Store, dataset: str, sequence: str) -> Iterator[Frame]:
    """Yield the usable frames of `frames`, in order, as the dataset first gave them."""
    tables = store.tables(dataset, sequence, ROUND)
    paths = dict(_path_pairs(tables.read("images"), "image"))
    points = dict(_path_pairs(tables.read("sweeps"), "path"))
    for row in tables.read("frames").to_pylist():
        if row["status"] == "ok":
            yield frame_of_row(row, paths.get(row["frame"]), points.get(row["frame"]))


def _path_pairs(table: Any, column: str) -> Iterator[tuple[int, str | None]]:
    for frame, value in zip(table["frame"].to_pylist(), table[column].to_pylist(), strict=True):
        yield frame, value["path"] if isinstance(value, dict) else value


def frame_of_row(row: dict[str, Any], image: str | None, points: str | None) -> Frame:
    """Return the frame that a row of `frames` and the paths of its files stand for."""
    camera = None
    if row["projection"] is not None and row["width_px"] is not None:
        camera = Camera(_matrix(row["projection"], 3), row["width_px"], row["height_px"])
    return Frame(
        row["dataset"],
        row["sequence"],
        row["frame"],
        row["timestamp_ns"],
        camera,
        _matrix(row["camera_T_level"], 4),
        _matrix(row["level_T_sensor"], 4),
        image,
        points,
        "ok",
        row["error"],
        row["image_error"],
    )


def _matrix(values: Sequence[float], rows: int) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(values[4 * i : 4 * i + 4]) for i in range(rows))


def _sequence_columns(info: SequenceInfo, frames: list[Frame]) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {
        name: [getattr(info, name)]
        for name in (
            "root", "sensor", "metric_scale", "static_camera", "calibration", "fingerprint",
            "number_of_frames",
        )
    }  # fmt: skip
    columns["first_timestamp_ns"] = [frames[0].timestamp_ns]
    columns["last_timestamp_ns"] = [frames[-1].timestamp_ns]
    return columns


def _frame_columns(checked: list[tuple[Frame, int | None]]) -> dict[str, list[Any]]:
    frames = [frame for frame, _ in checked]
    return {
        "frame": [f.frame for f in frames],
        "timestamp_ns": [f.timestamp_ns for f in frames],
        "width_px": [f.camera.width_px if f.camera else None for f in frames],
        "height_px": [f.camera.height_px if f.camera else None for f in frames],
        "projection": [_flat(f.camera.projection) if f.camera else None for f in frames],
        "camera_T_level": [_flat(f.camera_T_level) for f in frames],
        "level_T_sensor": [_flat(f.level_T_sensor) for f in frames],
        "has_image": [f.has_image for f in frames],
        "number_of_points": [count for _, count in checked],
        "status": [f.status for f in frames],
        "error": [f.error for f in frames],
        "image_error": [f.image_error for f in frames],
    }


def _flat(matrix: tuple[tuple[float, ...], ...]) -> list[float]:
    return [float(value) for row in matrix for value in row]


def _image_columns(frames: list[Frame]) -> dict[str, list[Any]]:
    return {
        "frame": [f.frame for f in frames],
        "image": [{"bytes": None, "path": f.image_path} for f in frames],
    }


def _sweep_columns(usable: list[tuple[Frame, int | None]]) -> dict[str, list[Any]]:
    return {
        "frame": [f.frame for f, _ in usable],
        "path": [f.points_path for f, _ in usable],
        "number_of_points": [count for _, count in usable],
    }


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return value
