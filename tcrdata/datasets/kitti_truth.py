"""Turns KITTI's labels into rows of `ground_truth`: image boxes, rotations and speeds."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np

from tcrdata.datasets.kitti_calibration import Calibration, read_imu_mounting
from tcrdata.datasets.kitti_labels import LabelledObject, read_label_file, read_tracklets
from tcrdata.datasets.kitti_layout import SequenceFiles
from tcrdata.datasets.kitti_timestamps import sequence_timestamps
from tcrdata.datasets.oxts import read_poses
from tcrdata.geometry.transforms import inverse
from tcrdata.types import Camera, FloatArray, Frame

_NEAR_M = 0.1
# Labels jitter by some centimetres a frame: over +-0.3 s that is below 0.3 m/s in the speed.
_SPEED_HALF_WINDOW_FRAMES = 3
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_EDGES = [
    (a, b)
    for a, b in combinations(range(8), 2)
    if np.count_nonzero(_CORNERS[a] != _CORNERS[b]) == 1
]


def truth_rows(
    files: SequenceFiles, calibration: Calibration, frames: Sequence[Frame]
) -> list[dict[str, Any]]:
    """Return rows of `ground_truth` for the frames that are there, by frame, then by object.

    Args:
        files: the sequence.
        calibration: its camera and LiDAR.
        frames: every frame of the sequence.

    Raises:
        DatasetError: labels, GPS/IMU packets, their calibration or timestamps cannot be read.
    """
    labels = _read_labels(files, calibration)
    speed_mps = _read_speeds(files, calibration, labels)
    cameras = {frame.frame: frame.camera for frame in frames if frame.camera is not None}
    rows = []
    for label in labels:
        seen = _seen(label, cameras[label.frame]) if label.frame in cameras else None
        if seen is not None:
            rows.append(truth_row(seen, speed_mps.get((label.object_id, label.frame))))
    return sorted(rows, key=lambda row: int(row["frame"]))


def truth_row(label: LabelledObject, speed_mps: float | None) -> dict[str, Any]:
    """Return the label as a row of `ground_truth`, without dataset, sequence and round."""
    box = label.box or (None,) * 7
    image_box = label.image_box_px or (None,) * 4
    yaw = box[6]
    return {
        "frame": label.frame,
        "object_id": label.object_id,
        "category": label.category,
        **dict(zip(("x_m", "y_m", "z_m", "length_m", "width_m", "height_m"), box[:6], strict=True)),
        "yaw_rad": yaw,
        "level_R_object": None if yaw is None else _rotation(yaw).ravel().tolist(),
        "object_size_m": None if label.box is None else [box[3], box[5], box[4]],
        **dict(zip(("left_px", "top_px", "right_px", "bottom_px"), image_box, strict=True)),
        "truncated": label.truncated,
        "occluded": label.occluded,
        "visible_px": None,
        "speed_mps": speed_mps,
        "yaw_observable": True,
        "contained_in": None,
    }


def image_box(box: Sequence[float], camera: Camera) -> tuple[float, ...] | None:
    """Return left, top, right, bottom (px) of a box's projection, cut at the image's edges.

    Args:
        box: x, y, z, length, width, height (m), yaw (rad) in the camera frame.
        camera: the image's camera.

    Returns:
        None when no part of the box is in the image.
    """
    # Axes of the object: length along the heading, height down, width to complete them.
    corners = _CORNERS * [box[3], box[5], box[4]] @ _rotation(box[6]).T + np.asarray(box[:3])
    homogeneous = corners @ camera.matrix[:, :3].T + camera.matrix[:, 3]
    depth = homogeneous[:, 2] - _NEAR_M
    visible = [homogeneous[depth >= 0]]
    for a, b in _EDGES:
        if (depth[a] < 0) != (depth[b] < 0):
            share = depth[a] / (depth[a] - depth[b])
            visible.append((homogeneous[a] + share * (homogeneous[b] - homogeneous[a]))[None])
    points = np.concatenate(visible)
    if len(points) == 0:
        return None
    pixels = points[:, :2] / points[:, 2:]
    last = np.array([camera.width_px - 1.0, camera.height_px - 1.0])
    low, high = np.clip(pixels.min(0), 0, last), np.clip(pixels.max(0), 0, last)
    if (low >= high).any():
        return None
    return tuple(float(v) for v in (*low, *high))


def speeds(
    labels: Sequence[LabelledObject],
    world_T_level: Mapping[int, FloatArray],
    time_s: Mapping[int, float],
) -> dict[tuple[str, int], float]:
    """Return speeds over the ground (m/s) by object and frame.

    The slope of the straight line that fits the object's horizontal positions in the world best,
    over the labelled frames up to three away. Frames without a pose or a time have no speed.

    Args:
        labels: every label of the sequence.
        world_T_level: (4, 4) by frame; the world's z points up.
        time_s: by frame.
    """
    tracks: dict[str, dict[int, FloatArray]] = defaultdict(dict)
    for label in labels:
        pose = world_T_level.get(label.frame)
        if label.box is not None and pose is not None and label.frame in time_s:
            position = pose[:2, :3] @ np.asarray(label.box[:3]) + pose[:2, 3]
            tracks[label.object_id][label.frame] = np.array([time_s[label.frame], *position])
    result: dict[tuple[str, int], float] = {}
    for object_id, track in tracks.items():
        for frame in track:
            reach = range(frame - _SPEED_HALF_WINDOW_FRAMES, frame + _SPEED_HALF_WINDOW_FRAMES + 1)
            near = np.array([track[other] for other in reach if other in track])
            if len(near) >= 2:
                result[object_id, frame] = _slope(near)
    return result


def _read_labels(files: SequenceFiles, calibration: Calibration) -> list[LabelledObject]:
    if files.layout == "tracking":
        return read_label_file(files.labels)
    return read_tracklets(files.labels, calibration.level_T_sensor)


def _read_speeds(
    files: SequenceFiles, calibration: Calibration, labels: Sequence[LabelledObject]
) -> dict[tuple[str, int], float]:
    velo_T_imu = read_imu_mounting(files)
    if velo_T_imu is None or not labels:
        return {}
    imu_T_level = inverse(calibration.level_T_sensor @ velo_T_imu)
    poses = {frame: pose @ imu_T_level for frame, pose in read_poses(files.oxts).items()}
    numbers = sorted({label.frame for label in labels})
    times = sequence_timestamps(files, numbers)
    # Counted from the first frame: nanoseconds since 1970 do not fit a float's 53 bits.
    start_ns = min(time.time_ns for time in times.values())
    time_s = {n: (t.time_ns - start_ns) * 1e-9 for n, t in times.items() if t.error is None}
    return speeds(labels, poses, time_s)


def _seen(label: LabelledObject, camera: Camera) -> LabelledObject | None:
    """Return the label with its image box; None when no part of it is in the image."""
    if label.image_box_px is not None or label.box is None:
        return label
    projected = image_box(label.box, camera)
    return None if projected is None else replace(label, image_box_px=projected)


def _slope(samples: FloatArray) -> float:
    """Return the speed of the line fitted to (N, 3) rows of time, x, y."""
    centred = samples - samples.mean(axis=0)
    velocity = centred[:, 0] @ centred[:, 1:] / (centred[:, 0] @ centred[:, 0])
    return math.hypot(*velocity)


def _rotation(yaw: float) -> FloatArray:
    """Return (3, 3) `level_R_object`: columns are the axes length, height (down), width."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
