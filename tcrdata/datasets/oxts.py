"""Poses from OXTS GPS/IMU packets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tcrdata.datasets.kitti_layout import numbered_files
from tcrdata.errors import DatasetError
from tcrdata.types import FloatArray

_EARTH_RADIUS_M = 6_378_137.0
_POSE_FIELDS = 6


def read_poses(path: Path) -> dict[int, FloatArray]:
    """Return (4, 4) `world_T_imu` by frame; empty without the packets.

    The world is east, north, up from the first packet on. Position by the Mercator projection
    scaled to be true at the first latitude, `x = s r lon`, `y = s r ln tan(pi/4 + lat/2)`,
    `s = cos lat_0`; rotation `Rz(yaw) Ry(pitch) Rx(roll)`.
    Source: Geiger et al. 2013, section on coordinate systems.

    Args:
        path: a folder of one file a frame, or a file of one line a frame.

    Raises:
        DatasetError: a packet is broken; without it, objects of that frame would have no speed.
    """
    poses: dict[int, FloatArray] = {}
    scale: float | None = None
    origin = np.zeros(3)
    for frame, place, line in _packets(path):
        lat, lon, altitude_m, roll, pitch, yaw = _numbers(place, line)
        if scale is None:
            scale = math.cos(math.radians(lat))
            origin = _mercator(lat, lon, altitude_m, scale)
        pose = np.eye(4)
        pose[:3, :3] = _rotation(roll, pitch, yaw)
        pose[:3, 3] = _mercator(lat, lon, altitude_m, scale) - origin
        poses[frame] = pose
    return poses


def _packets(path: Path) -> Iterator[tuple[int, str, str]]:
    try:
        if path.is_dir():
            for frame, file in numbered_files(path, ".txt").items():
                yield frame, f"'{file.path}'", file.path.read_text(errors="replace")
        elif path.exists():
            for frame, line in enumerate(path.read_text(errors="replace").splitlines()):
                yield frame, f"'{path}', line {frame + 1}", line
    except OSError as error:
        raise DatasetError(f"cannot read the GPS/IMU packets '{path}': {error}") from error


def _numbers(place: str, line: str) -> list[float]:
    todo = "restore the packet, or build without the folder oxts: truth has no speeds then"
    try:
        numbers = [float(word) for word in line.split()[:_POSE_FIELDS]]
    except ValueError as error:
        raise DatasetError(f"{place}: {error}; {todo}") from error
    if len(numbers) < _POSE_FIELDS or not all(math.isfinite(n) for n in numbers):
        raise DatasetError(f"{place}: expected finite lat lon alt roll pitch yaw first; {todo}")
    if abs(numbers[0]) >= 90.0:
        raise DatasetError(
            f"{place}: the latitude {numbers[0]:g} is not between -90 and 90; {todo}"
        )
    return numbers


def _mercator(lat: float, lon: float, altitude_m: float, scale: float) -> FloatArray:
    east = scale * _EARTH_RADIUS_M * math.radians(lon)
    north = scale * _EARTH_RADIUS_M * math.log(math.tan(math.pi / 4 + math.radians(lat) / 2))
    return np.array([east, north, altitude_m])


def _rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, dtype=np.float64)
