"""Writes small generated KITTI folders, raw and tracking, of a street that is known exactly.

The car that carries the sensors drives east at 5 m/s; ahead of it a van drives at 14 m/s, and a car
is parked. Sweeps hold the ground and the faces of both boxes.
"""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

DRIVE = "2011_09_26_drive_0001_sync"
SEQUENCE = "0000"
WIDTH_PX, HEIGHT_PX = 160, 48
PERIOD_S = 0.1
EGO_MPS = 5.0
VAN_MPS = 14.0
SENSOR_HEIGHT_M = 1.73
EARTH_RADIUS_M = 6_378_137.0
LATITUDE_DEG, LONGITUDE_DEG = 49.0, 8.4

P2 = np.array([[93.0, 0.0, 79.5, 5.8], [0.0, 93.0, 22.0, 0.03], [0.0, 0.0, 1.0, 0.0027]])
AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def _turn(axis: int, angle_rad: float) -> np.ndarray:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    result = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    result[i, i], result[i, j], result[j, i], result[j, j] = c, -s, s, c
    return result


# Rectification undoes the camera's tilt, so that the rectified camera is level.
R_RECT = _turn(2, 0.01)
R_VELO_TO_CAM = R_RECT.T @ AXES
T_VELO_TO_CAM = R_RECT.T @ np.array([0.0, -0.08, -0.27])
LEVEL_T_SENSOR = np.block([[AXES, np.array([[0.0], [-0.08], [-0.27]])], [np.zeros((1, 3)), 1.0]])
R_IMU_TO_VELO = np.eye(3)
T_IMU_TO_VELO = np.array([-0.81, 0.32, -0.8])

# Number of the object, category, (length, width, height) m, position (x, y) at time 0 and speed
# along x in the world, yaw about the Velodyne's z.
OBJECTS: tuple[tuple[int, str, tuple[float, float, float], tuple[float, float], float, float], ...]
OBJECTS = (
    (0, "Van", (4.4, 1.8, 2.0), (14.0, 2.5), VAN_MPS, 0.0),
    (1, "Car", (3.9, 1.6, 1.5), (22.0, -3.5), 0.0, 0.1),
)


def write_raw(
    root: Path,
    drive: str = DRIVE,
    frames: int = 5,
    first_frame: int = 0,
    images: bool = True,
    labels: bool = True,
) -> Path:
    """Write a raw drive below `root` and return its folder.

    The timestamps list the whole drive, from frame 0 on, and the files begin at `first_frame`.
    """
    date = root / drive[:10]
    folder = date / drive
    numbers = range(first_frame, first_frame + frames)
    _write_raw_calibration(date)
    clocks = ["velodyne_points", "oxts"] + (["image_02"] if images else [])
    for sensor in clocks:
        (folder / sensor / "data").mkdir(parents=True)
        lines = [_timestamp(number) for number in range(numbers.stop + 3)]
        (folder / sensor / "timestamps.txt").write_text("\n".join(lines) + "\n")
    for number in numbers:
        sweep(number).tofile(folder / "velodyne_points" / "data" / f"{number:010d}.bin")
        (folder / "oxts" / "data" / f"{number:010d}.txt").write_text(packet(number) + "\n")
        if images:
            picture(number).save(folder / "image_02" / "data" / f"{number:010d}.png")
    if labels:
        (folder / "tracklet_labels.xml").write_text(tracklets(first_frame, frames))
    return folder


def write_tracking(
    root: Path,
    sequence: str = SEQUENCE,
    frames: int = 5,
    first_frame: int = 0,
    images: bool = True,
    labels: bool = True,
) -> Path:
    """Write a tracking sequence below `root` and return the `training` folder."""
    training = root / "training"
    numbers = range(first_frame, first_frame + frames)
    for name in ("calib", "oxts", "label_02", "velodyne", "image_02"):
        (training / name).mkdir(parents=True, exist_ok=True)
    (training / "calib" / f"{sequence}.txt").write_text(tracking_calibration())
    packets = [packet(number) for number in range(numbers.stop)]
    (training / "oxts" / f"{sequence}.txt").write_text("\n".join(packets) + "\n")
    (training / "velodyne" / sequence).mkdir()
    if images:
        (training / "image_02" / sequence).mkdir()
    for number in numbers:
        sweep(number).tofile(training / "velodyne" / sequence / f"{number:06d}.bin")
        if images:
            picture(number).save(training / "image_02" / sequence / f"{number:06d}.png")
    if labels:
        lines = [line for number in numbers for line in label_lines(number)]
        (training / "label_02" / f"{sequence}.txt").write_text("\n".join(lines) + "\n")
    return training


def sweep_file(folder: Path, frame: int) -> Path:
    """Return where a raw drive has a sweep."""
    return folder / "velodyne_points" / "data" / f"{frame:010d}.bin"


def image_file(folder: Path, frame: int) -> Path:
    """Return where a raw drive has an image."""
    return folder / "image_02" / "data" / f"{frame:010d}.png"


def sweep(number: int) -> np.ndarray:
    """Return (N, 4) float32: the ground and the boxes' faces, in the Velodyne's frame."""
    x, y = np.meshgrid(np.arange(3.0, 40.0, 0.5), np.arange(-12.0, 12.5, 0.5))
    parts = [np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -SENSOR_HEIGHT_M)])]
    parts.append(houses(EGO_MPS * PERIOD_S * number))
    for index in range(len(OBJECTS)):
        centre, size, yaw = box_in_sensor(index, number)
        grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 12)] * 3), axis=-1).reshape(-1, 3)
        faces = grid[np.abs(grid).max(axis=1) == 0.5] * size
        parts.append(faces @ _turn(2, yaw).T + centre)
    points = np.concatenate(parts)
    reflectance = np.linspace(0.0, 1.0, len(points))
    return np.column_stack([points, reflectance]).astype(np.float32)


def houses(driven_m: float) -> np.ndarray:
    """Return (N, 3) points of house fronts with corners, and of poles: egomotion needs them."""
    parts = []
    heights = np.arange(-1.2, 2.0, 0.3)
    for side in (-1, 1):
        for number in range(12):
            start = 9.0 * number + 2.0 * (side > 0)
            setback = side * (11.0 + (number * 5 % 4))
            along, up = np.meshgrid(start + np.arange(0.0, 6.0, 0.25), heights)
            parts.append(np.column_stack([along.ravel(), np.full(along.size, setback), up.ravel()]))
            across, up = np.meshgrid(setback + side * np.arange(0.0, 3.0, 0.25), heights)
            parts.append(np.column_stack([np.full(across.size, start), across.ravel(), up.ravel()]))
            turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, 8, endpoint=False), heights)
            pole = np.column_stack([0.15 * np.cos(turn.ravel()), 0.15 * np.sin(turn.ravel())])
            pole += (start + 7.5, side * 8.0)
            parts.append(np.column_stack([pole, up.ravel()]))
    points = np.concatenate(parts) - (driven_m, 0.0, 0.0)
    return points[(points[:, 0] > 2.0) & (points[:, 0] < 70.0)]


def box_in_sensor(index: int, number: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return an object's centre, (length, width, height) and yaw in the Velodyne's frame."""
    _, _, size, (x, y), speed, yaw = OBJECTS[index]
    ahead = x + (speed - EGO_MPS) * PERIOD_S * number
    return np.array([ahead, y, size[2] / 2 - SENSOR_HEIGHT_M]), np.array(size), yaw


def picture(number: int) -> Image.Image:
    """Return a pattern that moves with the frame."""
    columns, rows = np.meshgrid(np.arange(WIDTH_PX) + 2 * number, np.arange(HEIGHT_PX))
    waves = 127 + 60 * np.sin(columns / 3.0) + 60 * np.cos(rows / 4.0 + columns / 11.0)
    pixels = np.stack([waves, waves[:, ::-1], 255 - waves], axis=-1).astype(np.uint8)
    return Image.fromarray(pixels)


def packet(number: int) -> str:
    """Return the GPS/IMU line of a frame: driving east, level."""
    scale = math.cos(math.radians(LATITUDE_DEG))
    east_m = EGO_MPS * PERIOD_S * number
    longitude = LONGITUDE_DEG + math.degrees(east_m / (scale * EARTH_RADIUS_M))
    return " ".join(f"{v:.14g}" for v in (LATITUDE_DEG, longitude, 110.0, *[0.0] * 27))


def label_lines(number: int) -> list[str]:
    """Return the tracking benchmark's label lines of a frame."""
    lines = [f"{number} -1 DontCare -1 -1 -10 3 4 9 11 -1000 -1000 -1000 -10 -1 -1 -1"]
    for index, (track, category, *_) in enumerate(OBJECTS):
        (x, y, z), (length, width, height), ry = box_in_level(index, number)
        left, top, right, bottom = _image_box(index, number)
        alpha = ry - math.atan2(x, z)
        values = (left, top, right, bottom, height, width, length, x, y + height / 2, z, ry)
        numbers = " ".join(f"{v:.6f}" for v in values)
        lines.append(f"{number} {track} {category} 0 0 {alpha:.6f} {numbers}")
    return lines


def box_in_level(index: int, number: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return an object's centre, (length, width, height) and yaw in the level frame."""
    centre, size, yaw = box_in_sensor(index, number)
    return (LEVEL_T_SENSOR @ [*centre, 1.0])[:3], size, -yaw - math.pi / 2


def tracklets(first_frame: int, frames: int) -> str:
    """Return `tracklet_labels.xml`."""
    items = "".join(_tracklet(index, first_frame, frames) for index in range(len(OBJECTS)))
    return (
        '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n'
        "<!DOCTYPE boost_serialization>\n"
        '<boost_serialization signature="serialization::archive" version="9">\n'
        f"<tracklets><count>{len(OBJECTS)}</count><item_version>1</item_version>{items}"
        "</tracklets></boost_serialization>\n"
    )


def _tracklet(index: int, first_frame: int, frames: int) -> str:
    _, category, (length, width, height), _, _, yaw = OBJECTS[index]
    poses = ""
    for number in range(first_frame, first_frame + frames):
        x, y, z = box_in_sensor(index, number)[0] - [0.0, 0.0, height / 2]
        values: dict[str, Any] = {"tx": x, "ty": y, "tz": z, "rx": 0, "ry": 0, "rz": yaw}
        values |= {"state": 2, "occlusion": 0, "occlusion_kf": 0, "truncation": 0}
        poses += "<item>" + "".join(f"<{k}>{v}</{k}>" for k, v in values.items()) + "</item>\n"
    return (
        f"<item><objectType>{category}</objectType><h>{height}</h><w>{width}</w><l>{length}</l>"
        f"<first_frame>{first_frame}</first_frame><poses><count>{frames}</count>\n{poses}</poses>"
        "<finished>1</finished></item>\n"
    )


def _image_box(index: int, number: int) -> tuple[float, float, float, float]:
    centre, size, yaw = box_in_sensor(index, number)
    grid = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    corners = (grid * size) @ _turn(2, yaw).T + centre
    homogeneous = np.column_stack([corners, np.ones(8)]) @ (P2 @ LEVEL_T_SENSOR).T
    pixels = homogeneous[:, :2] / homogeneous[:, 2:]
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    return (
        max(left, 0.0),
        max(top, 0.0),
        min(right, WIDTH_PX - 1.0),
        min(bottom, HEIGHT_PX - 1.0),
    )


def tracking_calibration() -> str:
    """Return the calibration as the benchmark's own files have it: some keys lack the colon."""
    velo = np.column_stack([R_VELO_TO_CAM, T_VELO_TO_CAM])
    imu = np.column_stack([R_IMU_TO_VELO, T_IMU_TO_VELO])
    lines = [f"{key} {_numbers(P2)}" for key in ("P0:", "P1:", "P2:", "P3:")]
    lines += [f"R_rect {_numbers(R_RECT)}", f"Tr_velo_cam {_numbers(velo)}"]
    return "\n".join([*lines, f"Tr_imu_velo {_numbers(imu)}"]) + "\n"


def _write_raw_calibration(date: Path) -> None:
    date.mkdir(parents=True, exist_ok=True)
    cameras = [
        "calib_time: 09-Jan-2012 13:57:47",
        f"R_rect_00: {_numbers(R_RECT)}",
        f"S_rect_02: {_numbers(np.array([WIDTH_PX, HEIGHT_PX]))}",
        f"P_rect_02: {_numbers(P2)}",
    ]
    velo = [f"R: {_numbers(R_VELO_TO_CAM)}", f"T: {_numbers(T_VELO_TO_CAM)}"]
    imu = [f"R: {_numbers(R_IMU_TO_VELO)}", f"T: {_numbers(T_IMU_TO_VELO)}"]
    (date / "calib_cam_to_cam.txt").write_text("\n".join(cameras) + "\n")
    (date / "calib_velo_to_cam.txt").write_text("\n".join(velo) + "\n")
    (date / "calib_imu_to_velo.txt").write_text("\n".join(imu) + "\n")


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.12e}" for value in values.ravel())


def _timestamp(number: int) -> str:
    start = datetime(2011, 9, 26, 13, 2, 25)
    return f"{start + timedelta(seconds=PERIOD_S * number):%Y-%m-%d %H:%M:%S.%f}000"
