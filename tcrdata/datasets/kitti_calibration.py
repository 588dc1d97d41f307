"""Reads KITTI's calibration files and checks that they can be true."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tcrdata.datasets.kitti_layout import SequenceFiles
from tcrdata.errors import DatasetError
from tcrdata.types import FloatArray

_ROTATION_TOLERANCE = 1e-2
# The same matrix has two names in the copies of the tracking benchmark that are about.
_R_RECT = ("R_rect", "R0_rect")
_TR_VELO_CAM = ("Tr_velo_cam", "Tr_velo_to_cam")
_TR_IMU_VELO = ("Tr_imu_velo", "Tr_imu_to_velo")


@dataclass(frozen=True)
class Calibration:
    """The left colour camera and the LiDAR of one sequence.

    Attributes:
        projection: (3, 4), `P_rect_02` or `P2`: rectified camera 0 (m) to homogeneous pixels.
        level_T_sensor: (4, 4), Velodyne to rectified camera 0: `R_rect @ Tr_velo_cam`.
        image_size_px: (width, height) that the files give; None when they give none.
    """

    projection: FloatArray
    level_T_sensor: FloatArray
    image_size_px: tuple[int, int] | None


def read_calibration(files: SequenceFiles) -> Calibration:
    """Read the camera's and the LiDAR's calibration.

    Raises:
        DatasetError: a file or key is missing, or its numbers cannot be a calibration.
    """
    if files.layout == "tracking":
        calib = _KeyFile(files.calibration[0])
        rectify, cam_T_velo = calib.rotation(*_R_RECT), calib.transform(*_TR_VELO_CAM)
        projection, size = calib.projection("P2"), None
    else:
        cameras, velodyne = (_KeyFile(path) for path in files.calibration)
        rectify, cam_T_velo = cameras.rotation("R_rect_00"), velodyne.rotation_and_translation()
        projection, size = cameras.projection("P_rect_02"), cameras.image_size("S_rect_02")
    rectified_T_cam = np.eye(4)
    rectified_T_cam[:3, :3] = rectify
    return Calibration(projection, rectified_T_cam @ cam_T_velo, size)


def read_imu_mounting(files: SequenceFiles) -> FloatArray | None:
    """Read the (4, 4) transform from the IMU to the Velodyne; None when there is no such file.

    Raises:
        DatasetError: the file is there and wrong.
    """
    if not files.imu_calibration.is_file():
        return None
    calib = _KeyFile(files.imu_calibration)
    if files.layout == "tracking":
        return calib.transform(*_TR_IMU_VELO)
    return calib.rotation_and_translation()


class _KeyFile:
    """Lines `key: numbers`, the colon missing in some of the tracking benchmark's files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DatasetError(
                f"cannot read the calibration '{path}': {reason}; restore it"
            ) from error
        words = [line.split() for line in lines]
        self.values = {line[0].rstrip(":"): line[1:] for line in words if line}

    def numbers(self, count: int, *names: str) -> FloatArray:
        """Return the numbers of the first key that is there."""
        name = next((name for name in names if name in self.values), None)
        if name is None:
            raise DatasetError(f"'{self.path}' has no key '{names[0]}': restore the calibration")
        numbers = np.array([_number(word) for word in self.values[name]])
        if len(numbers) != count:
            raise self.wrong(name, f"expected {count} numbers, found {len(numbers)}")
        for word, number in zip(self.values[name], numbers, strict=True):
            if not np.isfinite(number):
                raise self.wrong(name, f"'{word[:40]}' is not a finite number")
        return numbers

    def wrong(self, name: str, what: str) -> DatasetError:
        """Return the error that says what is wrong with a key."""
        return DatasetError(f"'{self.path}', key '{name}': {what}; restore the calibration")

    def rotation(self, *names: str) -> FloatArray:
        """Return a (3, 3) rotation."""
        return self._checked(self.numbers(9, *names).reshape(3, 3), names[0])

    def transform(self, *names: str) -> FloatArray:
        """Return a (4, 4) transform written as 12 numbers."""
        result = np.eye(4)
        result[:3] = self.numbers(12, *names).reshape(3, 4)
        self._checked(result[:3, :3], names[0])
        return result

    def rotation_and_translation(self) -> FloatArray:
        """Return the (4, 4) transform of the keys R and T."""
        result = np.eye(4)
        result[:3, :3] = self.rotation("R")
        result[:3, 3] = self.numbers(3, "T")
        return result

    def projection(self, name: str) -> FloatArray:
        """Return a (3, 4) projection."""
        result = self.numbers(12, name).reshape(3, 4)
        if min(result[0, 0], result[1, 1], result[2, 2]) <= 0:
            raise self.wrong(name, "the focal lengths and the scale must be positive")
        return result

    def image_size(self, name: str) -> tuple[int, int] | None:
        """Return (width, height) in pixels; None without the key."""
        if name not in self.values:
            return None
        width, height = self.numbers(2, name)
        if min(width, height) < 1:
            raise self.wrong(name, "the sizes must be positive")
        return int(width), int(height)

    def _checked(self, rotation: FloatArray, name: str) -> FloatArray:
        error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if error > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            allowed = f"at most {_ROTATION_TOLERANCE:g} allowed"
            raise self.wrong(name, f"not a rotation (off by {error:.3g}, {allowed})")
        return rotation


def _number(word: str) -> float:
    """Return a word's number; NaN where it is none."""
    try:
        return float(word)
    except ValueError:
        return np.nan
