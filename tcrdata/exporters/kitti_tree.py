"""The folders of KITTI's detection set: `training/{calib,image_2,velodyne}` by running numbers.

Source: the readme of KITTI's object development kit; a calibration file has a line for each of
P0 to P3, R0_rect, Tr_velo_to_cam and Tr_imu_to_velo.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.exporters.cameras import camera_poses
from tcrdata.exporters.frame_images import FrameImages
from tcrdata.exporters.frame_points import FramePoints, lidar_poses
from tcrdata.exporters.labels import SequenceLabels
from tcrdata.exporters.text_files import write_texts
from tcrdata.geometry.transforms import inverse
from tcrdata.store.table_arrays import matrices
from tcrdata.types import FloatArray

TRAINING = "training"
FILES = ("calib/{}.txt", "image_2/{}.png", "velodyne/{}.bin")
_UNIT_CAMERA = np.eye(3, 4)
_SWEEPS_OF = "kitti"  # the dataset whose sweeps are files of this format already

TREE_LINES = (
    ("velodyne", "x forward, y left, z up, reflectance 0 to 1; float32; a link where KITTI has it"),
    (
        "calib",
        "P0 to P3 are all the camera's own projection (of unit focal length without a camera); "
        "R0_rect is the identity, within Tr_velo_to_cam; Tr_imu_to_velo is unknown: the identity",
    ),
)
"""The lines of the card about the folders."""


def projections(part: SequenceLabels) -> FloatArray:
    """Return (F, 3, 4) camera frame to pixels; of unit focal length where there is no camera."""
    found = matrices(part.frames, "projection", (3, 4))
    found[np.isnan(found).any(axis=(1, 2))] = _UNIT_CAMERA
    return found


def lidar_to_camera(part: SequenceLabels) -> FloatArray:
    """Return (F, 4, 4) `camera_T_lidar` of every frame."""
    poses, lidars = camera_poses(part), lidar_poses(part)
    result = np.empty_like(poses)
    for row in range(len(poses)):
        same = (
            row > 0
            and np.array_equal(poses[row], poses[row - 1])
            and np.array_equal(lidars[row], lidars[row - 1])
        )
        result[row] = result[row - 1] if same else poses[row] @ inverse(lidars[row])
    return result


def make_folders(folder: Path, names: tuple[str, ...]) -> Path:
    """Make folders below `training/` and return that."""
    training = folder / TRAINING
    for name in names:
        (training / name).mkdir(parents=True, exist_ok=True)
    return training


def write_calibrations(training: Path, part: SequenceLabels, names: list[str]) -> None:
    """Write `calib/<name>.txt` of every frame."""
    files = (f"{name}.txt" for name in names)
    write_texts(training / "calib", zip(files, _calibrations(part), strict=True))


def _calibrations(part: SequenceLabels) -> Iterator[str]:
    """The text of every frame's calibration."""
    cameras, transforms = projections(part), lidar_to_camera(part)
    text = ""
    for row in range(len(cameras)):
        same = (
            row > 0
            and np.array_equal(cameras[row], cameras[row - 1])
            and np.array_equal(transforms[row], transforms[row - 1])
        )
        if not same:
            text = _calibration(cameras[row], transforms[row])
        yield text


def place_images(training: Path, part: SequenceLabels, names: list[str]) -> None:
    """Put each frame's image at `image_2/<name>.png`: a link to the dataset's PNG, else a copy."""
    images = FrameImages(part)
    for row, name in enumerate(names):
        if images.has_image(row):
            images.put(row, training / "image_2" / f"{name}.png")


def place_points(training: Path, part: SequenceLabels, names: list[str]) -> None:
    """Put each frame's points at `velodyne/<name>.bin`: a link to KITTI's own sweep, else written.

    Raises:
        FrameError: the points are gone since the build.
    """
    points = FramePoints(part)
    paths: list[str | None] = part.frames["points_path"].to_pylist()
    for row, name in enumerate(names):
        target = training / "velodyne" / f"{name}.bin"
        path = paths[row]
        if part.dataset == _SWEEPS_OF and path is not None:
            _link(Path(part.root) / path, target)
        else:
            target.unlink(missing_ok=True)
            points.read(row).tofile(target)


def _link(source: Path, target: Path) -> None:
    """Link to a file of the dataset; a copy where a file system has no links."""
    target.unlink(missing_ok=True)
    try:
        target.symlink_to(source.resolve(strict=True))
    except FileNotFoundError as error:
        raise FrameError(
            f"{source} is gone since the build: put it back, or add --labels-only"
        ) from error
    except OSError:
        shutil.copyfile(source, target)


def _calibration(projection: FloatArray, camera_T_lidar: FloatArray) -> str:
    lines = [(f"P{camera}", projection) for camera in range(4)]
    lines += [
        ("R0_rect", np.eye(3)),
        ("Tr_velo_to_cam", camera_T_lidar[:3]),
        ("Tr_imu_to_velo", np.eye(3, 4)),
    ]
    return "".join(
        f"{name}: " + " ".join(f"{value:.12e}" for value in matrix.ravel()) + "\n"
        for name, matrix in lines
    )
