"""Finds the sequences of a KITTI folder, in the raw and in the tracking layout, by looking."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tcrdata.errors import DatasetError


@dataclass(frozen=True)
class SequenceFiles:
    """Where the files of one sequence lie; only `sweeps` is known to exist.

    Attributes:
        name: the drive's folder name (raw) or the sequence's number (tracking).
        layout: `raw` or `tracking`.
        base: the folder that names in a fingerprint are relative to.
        sweeps: folder of the Velodyne sweeps.
        images: folder of the left colour camera's images.
        calibration: the files that place the camera and the LiDAR.
        imu_calibration: the file that places the IMU in the LiDAR's frame.
        timestamps: one file a sensor, the sweeps' first; empty for tracking, which has none.
        oxts: a folder with one file a frame (raw) or a file with one line a frame (tracking).
        labels: the label file.
    """

    name: str
    layout: Literal["raw", "tracking"]
    base: Path
    sweeps: Path
    images: Path
    calibration: tuple[Path, ...]
    imu_calibration: Path
    timestamps: tuple[Path, ...]
    oxts: Path
    labels: Path


@dataclass(frozen=True)
class DataFile:
    """A sweep or an image.

    Attributes:
        path: where it lies.
        size_bytes: its size.
    """

    path: Path
    size_bytes: int


def find_sequences(root: Path) -> dict[str, SequenceFiles]:
    """Return the sequences below `root` by name, sorted.

    `root` may hold dates (`<date>/<drive>_sync`), be a date or a drive, or hold `training`, or be
    `training` (or `testing`) itself.

    Raises:
        DatasetError: `root` is no folder, or neither layout is in it.
    """
    if not root.is_dir():
        raise DatasetError(f"'{root}' is not a folder: give the folder that holds KITTI")
    found: dict[str, SequenceFiles] = {}
    for files in (*_raw_drives(root), *_tracking_sequences(root)):
        if files.name in found:
            raise DatasetError(
                f"'{files.name}' is in '{found[files.name].base}' and in '{files.base}': keep one"
            )
        found[files.name] = files
    if not found:
        raise DatasetError(
            f"'{root}' is not KITTI: found neither <date>/<drive>_sync/velodyne_points (raw) "
            "nor training/velodyne/<sequence>/ (tracking) in it: give the folder above those"
        )
    return dict(sorted(found.items()))


def numbered_files(folder: Path, suffix: str) -> dict[int, DataFile]:
    """Return the files `<number><suffix>` of a folder by number, rising; empty without a folder."""
    if not folder.is_dir():
        return {}
    with os.scandir(folder) as entries:
        found = {
            int(entry.name.removesuffix(suffix)): DataFile(
                folder / entry.name, entry.stat().st_size
            )
            for entry in entries
            if entry.name.endswith(suffix)
            and entry.name.removesuffix(suffix).isdecimal()
            and entry.is_file()
        }
    return dict(sorted(found.items()))


def _raw_drives(root: Path) -> Iterator[SequenceFiles]:
    candidates = [root, *_folders(root)]
    candidates += [drive for date in candidates[1:] for drive in _folders(date)]
    for drive in candidates:
        # `_extract` drives are neither rectified nor synchronised.
        if (drive / "velodyne_points").is_dir() and not drive.name.endswith("_extract"):
            yield _raw(drive)


def _raw(drive: Path) -> SequenceFiles:
    date = drive.parent
    return SequenceFiles(
        name=drive.name,
        layout="raw",
        base=date,
        sweeps=drive / "velodyne_points" / "data",
        images=drive / "image_02" / "data",
        calibration=(date / "calib_cam_to_cam.txt", date / "calib_velo_to_cam.txt"),
        imu_calibration=date / "calib_imu_to_velo.txt",
        timestamps=(
            drive / "velodyne_points" / "timestamps.txt",
            drive / "image_02" / "timestamps.txt",
        ),
        oxts=drive / "oxts" / "data",
        labels=drive / "tracklet_labels.xml",
    )


def _tracking_sequences(root: Path) -> Iterator[SequenceFiles]:
    base = root / "training" if (root / "training").is_dir() else root
    for sweeps in _folders(base / "velodyne"):
        name = sweeps.name
        calibration = base / "calib" / f"{name}.txt"
        yield SequenceFiles(
            name=name,
            layout="tracking",
            base=base,
            sweeps=sweeps,
            images=base / "image_02" / name,
            calibration=(calibration,),
            imu_calibration=calibration,
            timestamps=(),
            oxts=base / "oxts" / f"{name}.txt",
            labels=base / "label_02" / f"{name}.txt",
        )


def _folders(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_dir())
