"""KITTI tracking results: `label_02/<sequence>.txt`, one object a line, the score last.

Fields: frame, track, type, truncated, occluded, alpha, left, top, right, bottom, height, width,
length, x, y, z, rotation_y, score. Source: the readme of KITTI's tracking development kit.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import TcrdataError
from tcrdata.exporters.labels import Card, no_labels, open_folder
from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.reports import run_report
from tcrdata.store import Store
from tcrdata.types import FloatArray

_CATEGORIES = ("Car", "Van", "Truck", "Pedestrian", "Person", "Cyclist", "Tram", "Misc")
_NEAREST_M = 0.01
_LEVEL = 0.9999
_ROWS_A_BATCH = 50_000
_BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
_BOX_2D = ("left_px", "top_px", "right_px", "bottom_px")


def export(
    store: Store,
    selection_id: str,
    out: str | Path,
    *,
    category: str = "Car",
    dataset: str | None = None,
    overwrite: bool = False,
) -> Card:
    """Write a selection's positive labels, one file for every sequence, empty ones too.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets `label_02/`.
        category: type written for every object: labels have no class, and readers of the format
            know KITTI's alone.
        dataset: export this dataset's sequences alone.
        overwrite: replace the `label_02/*.txt` of a folder that is not empty.

    Raises:
        TcrdataError: the folder is not empty, the category is none of KITTI's, or two datasets
            have a sequence of one name.
        MissingEvidenceError: there is no such selection, or it has no positive labels.
    """
    if category not in _CATEGORIES:
        known = ", ".join(_CATEGORIES)
        raise TcrdataError(f"KITTI has no type '{category}': choose one of {known}")
    connection = store.connect(tables=("labels", "frames", "sequences", "selections"))
    try:
        sequences = _sequences(connection, dataset)
        batches = _batches(connection, selection_id, dataset)
        first = next(batches, None)
        if first is None:
            raise no_labels(connection, selection_id)
        folder = open_folder(out, overwrite) / "label_02"
        _start_files(folder, sequences)
        labels, tilted = _write(folder, first, batches, category)
    finally:
        connection.close()
    return _card(str(out), len(sequences), labels, category, tilted)


def camera_boxes(boxes: FloatArray, camera_T_level: FloatArray) -> FloatArray:
    """Turn boxes of the level frame into KITTI's numbers.

    The geometric centre and the heading are carried into the camera frame; half the height is
    added along the camera's y. Readers that undo this get the exact centre even where the camera
    is tilted against the level frame.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw.
        camera_T_level: (N, 4, 4).

    Returns:
        (N, 7) height, width, length, x, y, z of the bottom centre, rotation_y in (-pi, pi].
    """
    rotation, shift = camera_T_level[:, :3, :3], camera_T_level[:, :3, 3]
    center = np.einsum("nij,nj->ni", rotation, boxes[:, :3]) + shift
    yaw = boxes[:, 6]
    heading = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    heading = np.einsum("nij,nj->ni", rotation, heading)
    center[:, 1] += boxes[:, 5] / 2
    rotation_y = np.arctan2(-heading[:, 2], heading[:, 0])
    return np.column_stack([boxes[:, 5], boxes[:, 4], boxes[:, 3], center, rotation_y])


def observation_angle(camera: FloatArray) -> FloatArray:
    """Return (N,) alpha = rotation_y - atan2(x, z), in (-pi, pi], of `camera_boxes` rows."""
    alpha = camera[:, 6] - np.arctan2(camera[:, 3], camera[:, 5])
    return np.asarray(np.pi - (np.pi - alpha) % (2 * np.pi))


def _sequences(connection: duckdb.DuckDBPyConnection, dataset: str | None) -> dict[str, str]:
    """Return sequence to dataset, sorted."""
    found: dict[str, str] = {}
    rows = connection.execute("select distinct sequence, dataset from sequences order by all")
    for sequence, owner in rows.fetchall():
        if dataset not in (None, owner):
            continue
        if sequence in found:
            raise TcrdataError(
                f"{found[sequence]} and {owner} both have a sequence '{sequence}': "
                "export one dataset at a time: give `dataset` to kitti_tracking.export()"
            )
        found[sequence] = owner
    if not found:
        raise TcrdataError(
            f"the store has no sequence of dataset '{dataset}': see `tcrdata status`"
        )
    return found


def _batches(
    connection: duckdb.DuckDBPyConnection, selection_id: str, dataset: str | None
) -> Iterator[Any]:
    parameters = {"selection_id": selection_id, "exported_dataset": dataset}
    relation = run_report(connection, "export_kitti_tracking", parameters)
    for batch in relation.to_arrow_reader(_ROWS_A_BATCH):
        if batch.num_rows:
            yield batch


def _start_files(folder: Path, sequences: dict[str, str]) -> None:
    """Empty the files of these sequences alone: others may be somebody's ground truth."""
    folder.mkdir(exist_ok=True)
    for sequence in sequences:
        (folder / f"{sequence}.txt").write_text("")


def _write(folder: Path, first: Any, rest: Iterator[Any], category: str) -> tuple[int, bool]:
    """Append every batch to its files; returns the labels written and whether a camera tilts."""
    labels, tilted = 0, False
    batch = first
    while batch is not None:
        owners = np.asarray(batch["sequence"].to_numpy(zero_copy_only=False))
        lines, tilts = _lines(batch, category)
        tilted |= tilts
        edges = np.flatnonzero(owners[1:] != owners[:-1]) + 1
        for part in np.split(np.arange(len(owners)), edges):
            with (folder / f"{owners[part[0]]}.txt").open("a", encoding="ascii") as file:
                file.writelines(lines[part[0] : part[-1] + 1])
        labels += len(owners)
        batch = next(rest, None)
    return labels, tilted


def _lines(batch: Any, category: str) -> tuple[list[str], bool]:
    boxes = _columns(batch, _BOX)
    poses = _matrices(batch["camera_T_level"], np.eye(4))
    camera = camera_boxes(boxes, poses)
    alpha = observation_angle(camera)
    image = _image_boxes(batch, boxes, poses)
    whole = zip(
        *(batch[name].to_pylist() for name in ("frame", "track_number", "truncated", "occluded")),
        strict=True,
    )
    score = batch["score"].to_numpy()
    numbers = np.column_stack([alpha, image, camera, score])
    lines = [
        f"{frame} {track} {category} {truncated} {occluded} "
        + " ".join([f"{value:.6f}" for value in row])
        + "\n"
        for (frame, track, truncated, occluded), row in zip(whole, numbers.tolist(), strict=True)
    ]
    return lines, bool(np.any(poses[:, 1, 1] < _LEVEL))


def _columns(batch: Any, names: tuple[str, ...]) -> FloatArray:
    columns = [batch[name].to_numpy(zero_copy_only=False).astype(np.float64) for name in names]
    return np.column_stack(columns)


def _matrices(column: Any, missing: NDArray[np.floating]) -> FloatArray:
    flat = missing.ravel().tolist()
    rows = [row or flat for row in column.to_pylist()]
    return np.array(rows, dtype=np.float64).reshape(-1, *missing.shape)


def _image_boxes(batch: Any, boxes: FloatArray, poses: FloatArray) -> FloatArray:
    """Return (N, 4) pixels: the labels' own, else their boxes projected, else -1."""
    image = _columns(batch, _BOX_2D)
    missing = np.flatnonzero(np.isnan(image).any(axis=1))
    if len(missing):
        projection = _matrices(batch["projection"], np.full((3, 4), np.nan))[missing]
        size = _columns(batch, ("width_px", "height_px"))[missing]
        image[missing] = _projected(boxes[missing], projection @ poses[missing], size)
    return image


def _projected(boxes: FloatArray, projection: FloatArray, size: FloatArray) -> FloatArray:
    """Return (N, 4) boxes around the projected corners, clipped; -1 behind or outside."""
    flat = box_corners_bev(boxes)
    half = boxes[:, 5:6] / 2
    sides = [
        np.stack([flat[:, :, 0], np.broadcast_to(y, flat.shape[:2]), flat[:, :, 1]], axis=2)
        for y in (boxes[:, 1:2] - half, boxes[:, 1:2] + half)
    ]
    corners = np.concatenate(sides, axis=1)
    shift = projection[:, None, :, 3]
    pixels = np.einsum("nij,nkj->nki", projection[:, :, :3], corners) + shift
    depth = pixels[:, :, 2]
    in_front = (depth > _NEAREST_M).all(axis=1)
    pixels = pixels[:, :, :2] / np.where(depth > _NEAREST_M, depth, np.nan)[:, :, None]
    low = np.clip(pixels.min(axis=1), 0, size - 1)
    high = np.clip(pixels.max(axis=1), 0, size - 1)
    seen = in_front & (high > low).all(axis=1)
    return np.where(seen[:, None], np.concatenate([low, high], axis=1), -1.0)


def _card(out: str, files: int, labels: int, category: str, tilted: bool) -> Card:
    frame = "camera of each frame: x right, y down, z forward (KITTI: rectified camera 0)"
    if tilted:
        frame += "; it is tilted here, and this format has no pitch: centres are exact"
    conventions = (
        ("file", "label_02/<sequence>.txt, 18 fields a line, the score last"),
        ("frame", frame),
        ("centre", "bottom centre of the box"),
        ("order", "height width length, then x y z"),
        ("yaw", "rotation_y about y: 0 along +x, -pi/2 along +z (forward)"),
        ("alpha", "rotation_y - atan2(x, z)"),
        ("units", "metres, radians, pixels; -1 -1 -1 -1 without a 2D box"),
        ("type", f"{category} for every object: the labels have no class"),
        ("truncated", "0 to 2; occluded 0 to 3, where 3 is unknown"),
        ("track", "whole numbers from 0 in each sequence"),
    )
    return Card("kitti-tracking", out, files, labels, conventions)
