"""KITTI, in the raw and in the tracking layout, found by looking.

The camera frame is the rectified camera 0, as KITTI's labels have it; KITTI's cameras are mounted
level, so the level frame is the same. Images are those of the left colour camera, `image_02`.
Source: Geiger et al., Vision meets Robotics: The KITTI Dataset, IJRR 2013.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.datasets.frame_numbers import consecutive_numbers
from tcrdata.datasets.image_files import png_size, read_rgb
from tcrdata.datasets.kitti_calibration import Calibration, read_calibration
from tcrdata.datasets.kitti_layout import (
    DataFile,
    SequenceFiles,
    find_sequences,
    numbered_files,
)
from tcrdata.datasets.kitti_sweeps import read_sweep, size_error, to_level
from tcrdata.datasets.kitti_timestamps import Timestamp, sequence_timestamps
from tcrdata.datasets.kitti_truth import truth_rows
from tcrdata.errors import DatasetError, FrameError
from tcrdata.geometry.transforms import as_tuples
from tcrdata.types import Camera, Frame, ImageArray, PointCloud, SequenceInfo

_DEFAULT_SIZE_PX = (1242, 375)


def open_dataset(root: str | None) -> KittiDataset:
    """Open a folder that holds KITTI raw drives or tracking sequences.

    Args:
        root: the folder that holds `<date>/<drive>_sync` or `training`; a date, a drive or
            `training` itself will do too.

    Raises:
        DatasetError: no root is given, or neither layout is there.
    """
    if not root:
        raise DatasetError("KITTI needs a root: the folder that holds <date>/ or training/")
    folder = Path(root).expanduser().absolute()
    find_sequences(folder)
    return KittiDataset(str(folder))


@dataclass(frozen=True)
class KittiDataset:
    """A handle to a KITTI folder; reads lazily, keeps nothing.

    Attributes:
        root: the folder, absolute; paths of frames are relative to it.
        name: the dataset's name in every table.
    """

    root: str
    name: str = "kitti"

    def sequences(self) -> list[str]:
        """Return the names of the drives and tracking sequences, sorted."""
        return list(find_sequences(Path(self.root)))

    def info(self, sequence: str) -> SequenceInfo:
        """Return the sequence's row.

        Raises:
            DatasetError: the sequence is unknown, or its calibration is missing or wrong.
        """
        files = self._files(sequence)
        listing = _list_files(files)
        calibration = read_calibration(files)
        _, source = _image_size(listing, calibration)
        names = ", ".join(path.relative_to(files.base).as_posix() for path in files.calibration)
        return SequenceInfo(
            dataset=self.name,
            sequence=sequence,
            root=self.root,
            sensor="lidar",
            metric_scale=1.0,
            static_camera=False,
            calibration=f"{names}; image size from {source}{_other_clock(files)}",
            fingerprint=_fingerprint(files, listing),
            number_of_frames=len(listing.numbers),
        )

    def frames(self, sequence: str) -> list[Frame]:
        """Return a row for each number from the first image or sweep to the last, rising.

        A sweep that is missing or of an impossible size, or a wrong timestamp, makes status
        `error`; a missing, cut or odd-sized image sets `image_error`.

        Raises:
            DatasetError: the sequence is unknown, or its calibration is missing or wrong.
        """
        files = self._files(sequence)
        listing = _list_files(files)
        calibration = read_calibration(files)
        size, _ = _image_size(listing, calibration)
        times = sequence_timestamps(files, listing.numbers)
        common = Frame(
            dataset=self.name,
            sequence=sequence,
            frame=0,
            timestamp_ns=0,
            camera=Camera(as_tuples(calibration.projection), *size),
            camera_T_level=as_tuples(np.eye(4)),
            level_T_sensor=as_tuples(calibration.level_T_sensor),
        )
        return [self._frame(common, n, listing, times[n]) for n in listing.numbers]

    def read_points(self, frame: Frame) -> PointCloud:
        """Return every point of the sweep in file order, in the level frame.

        Raises:
            FrameError: the sweep is missing, cut short, empty, or holds a number that is not
                finite.
        """
        if frame.points_path is None:
            raise FrameError(f"frame {frame.frame} of '{frame.sequence}' has no sweep")
        path = Path(self.root) / frame.points_path
        points = read_sweep(path, frame.frame)
        return PointCloud(*to_level(points, frame.sensor_matrix, frame.frame, path.name))

    def read_image(self, frame: Frame) -> ImageArray:
        """Return the (H, W, 3) RGB image of the left colour camera.

        Raises:
            FrameError: there is no image, or it cannot be used.
        """
        place = f"frame {frame.frame} of '{frame.sequence}'"
        if frame.image_error is not None or frame.image_path is None or frame.camera is None:
            raise FrameError(f"{place}: {frame.image_error or 'no image'}")
        image = read_rgb(Path(self.root) / frame.image_path)
        if image.shape[:2] != (frame.camera.height_px, frame.camera.width_px):
            raise FrameError(f"{place}: the image has another size than its sequence")
        return image

    def ground_truth(self, sequence: str) -> list[dict[str, Any]]:
        """Return a row for each labelled object in the frames that are there.

        Boxes are upright, as KITTI's labels are; image boxes are the file's (tracking) or the
        projected 3D boxes (raw, which has no regions left out of scoring). Empty without labels.

        Raises:
            DatasetError: labels, GPS/IMU packets, calibration or timestamps cannot be read.
        """
        files = self._files(sequence)
        return truth_rows(files, read_calibration(files), self.frames(sequence))

    def _files(self, sequence: str) -> SequenceFiles:
        found = find_sequences(Path(self.root))
        if sequence not in found:
            raise DatasetError(
                f"no sequence '{sequence}' in '{self.root}': there are {', '.join(found)}"
            )
        return found[sequence]

    def _frame(self, common: Frame, number: int, listing: _Listing, time: Timestamp) -> Frame:
        sweep, image = listing.sweeps.get(number), listing.images.get(number)
        if sweep is not None:
            error = size_error(sweep.path.name, sweep.size_bytes) or time.error
        elif image is not None or not listing.images:
            error = "no sweep; fetch its .bin again"
        else:
            error = "neither sweep nor image; fetch its .bin and .png again"
        return replace(
            common,
            frame=number,
            timestamp_ns=time.time_ns,
            image_path=self._relative(image),
            points_path=self._relative(sweep),
            status="error" if error else "ok",
            error=error,
            image_error=_image_error(number, listing, common.camera),
        )

    def _relative(self, file: DataFile | None) -> str | None:
        return None if file is None else file.path.relative_to(self.root).as_posix()


@dataclass(frozen=True)
class _Listing:
    """The sweeps and images of a sequence by frame number, and the images' sizes or faults.

    `numbers` rises from the first file's to the last one's.
    """

    numbers: list[int]
    sweeps: dict[int, DataFile]
    images: dict[int, DataFile]
    sizes_px: dict[int, tuple[int, int]]
    image_faults: dict[int, str]


def _list_files(files: SequenceFiles) -> _Listing:
    images = numbered_files(files.images, ".png")
    sizes_px: dict[int, tuple[int, int]] = {}
    faults: dict[int, str] = {}
    for number, image in images.items():
        try:
            sizes_px[number] = png_size(image.path)
        except FrameError as error:
            faults[number] = str(error)
    sweeps = numbered_files(files.sweeps, ".bin")
    numbers = consecutive_numbers(sweeps.keys() | images.keys(), f"'{files.sweeps.parent}'")
    if not numbers:
        raise DatasetError(
            f"'{files.name}' has no frames: neither {files.sweeps}/<number>.bin nor "
            f"{files.images}/<number>.png"
        )
    return _Listing(numbers, sweeps, images, sizes_px, faults)


def _image_size(listing: _Listing, calibration: Calibration) -> tuple[tuple[int, int], str]:
    """Return (width, height) in pixels and where it is from; of several sizes the commonest."""
    if listing.sizes_px:
        return Counter(listing.sizes_px.values()).most_common(1)[0][0], "the images"
    if calibration.image_size_px is not None:
        return calibration.image_size_px, "S_rect_02"
    return _DEFAULT_SIZE_PX, "KITTI's usual 1242x375"


def _other_clock(files: SequenceFiles) -> str:
    """Say which clock the times are from where that is not the sweeps'; else nothing."""
    clock = next((path for path in files.timestamps if path.is_file()), None)
    if clock is None or clock == files.timestamps[0]:
        return ""
    return f"; times from {clock.relative_to(files.base).as_posix()}, as the sweeps have none"


def _image_error(number: int, listing: _Listing, camera: Camera | None) -> str | None:
    if number in listing.image_faults:
        return listing.image_faults[number]
    if number not in listing.images:
        return "no image; fetch its .png again" if listing.images else "the sequence has no images"
    width, height = listing.sizes_px[number]
    if camera is None or (width, height) != (camera.width_px, camera.height_px):
        name = listing.images[number].path.name
        return f"image {name} is {width}x{height}, unlike its sequence: fetch it again"
    return None


def _fingerprint(files: SequenceFiles, listing: _Listing) -> str:
    digest = hashlib.sha256()
    for path in (*files.calibration, *files.timestamps):
        if path.is_file():
            _add(digest, path.relative_to(files.base).as_posix(), path.read_bytes())
    for file in (*listing.sweeps.values(), *listing.images.values()):
        name = file.path.relative_to(files.base).as_posix()
        _add(digest, name, str(file.size_bytes).encode())
    return digest.hexdigest()


def _add(digest: Any, *parts: str | bytes) -> None:
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "big") + data)
