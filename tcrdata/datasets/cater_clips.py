"""Clips on disk: where their files lie, and how they are read.

    ROOT/<clip>/calibration.json
    ROOT/<clip>/camera_<n>/rgb/<frame>.png      8 bit RGB
    ROOT/<clip>/camera_<n>/depth/<frame>.png    16 bit grey: depth along the camera's z, 0 = none
    ROOT/<clip>/truth.json                      optional; read by `ground_truth` alone

calibration.json: `frames_per_second`, `depth_unit_m` (metres a step of a depth image) and
`cameras`, one a folder: `width_px`, `height_px`, `intrinsics_px` [fx, fy, cx, cy] and
`world_T_camera` (4 rows of 4): camera (x right, y down, z forward) to world (z up), metres.

truth.json: `objects` with `object_id`, `shape` (sphere, box, cylinder or cone, apex up), `size_m`
(along its own x, y and z) and `world_T_object`, a 4x4 pose of its centre for every frame from 0 on;
and `containments` with `inner`, `outer` (object ids), `first_frame` and `last_frame` (null: to the
end). Boxes, silhouettes and hidden shares follow from these by ray casting.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.datasets.cater_truth import read_scene
from tcrdata.datasets.frame_numbers import consecutive_numbers
from tcrdata.datasets.image_files import png_size, read_grey16, read_rgb
from tcrdata.datasets.kitti_layout import DataFile, numbered_files
from tcrdata.datasets.scene import Scene, View
from tcrdata.datasets.views import level_view
from tcrdata.errors import DatasetError, FrameError
from tcrdata.geometry.transforms import inverse
from tcrdata.types import Camera, FloatArray, ImageArray

CALIBRATION = "calibration.json"
TRUTH = "truth.json"


@dataclass(frozen=True)
class Calibration:
    """What calibration.json says.

    Attributes:
        text: the file's.
        frames_per_second: of the clip.
        depth_unit_m: metres a step of a depth image.
        views: one a camera.
    """

    text: str
    frames_per_second: float
    depth_unit_m: float
    views: tuple[View, ...]


@dataclass(frozen=True)
class RecordedClips:
    """Clips in a folder; see `cater.Clips` for the methods.

    Attributes:
        root: the folder.
    """

    root: str

    def names(self) -> list[str]:
        """Names of the clips, sorted.

        Raises:
            DatasetError: there is none.
        """
        found = sorted(path.parent.name for path in Path(self.root).glob(f"*/{CALIBRATION}"))
        if not found:
            raise DatasetError(
                f"{self.root}: no clip: each is a folder with {CALIBRATION} and camera_0/depth"
            )
        return found

    def has(self, clip: str, camera: int) -> bool:
        """Whether there is such a camera."""
        is_name = bool(clip) and Path(clip).name == clip
        return (
            is_name and (self._clip(clip) / CALIBRATION).is_file() and camera < self.cameras(clip)
        )

    def cameras(self, clip: str) -> int:
        """Number of cameras; raises DatasetError."""
        return len(self._calibration(clip).views)

    def numbers(self, clip: str, camera: int) -> list[int]:
        """Numbers of the frames from the first image or depth image to the last, rising.

        Raises:
            DatasetError: a file has a number far from all others.
        """
        found = self._files(clip, camera, "rgb").keys() | self._files(clip, camera, "depth").keys()
        return consecutive_numbers(found, self._clip(clip) / f"camera_{camera}")

    def frames_per_second(self, clip: str) -> float:
        """Frames a second; raises DatasetError."""
        return self._calibration(clip).frames_per_second

    def calibration(self, clip: str) -> str:
        """Where the cameras' places come from."""
        return f"{clip}/{CALIBRATION}"

    def identity(self, clip: str, camera: int) -> str:
        """Return the calibration's text, and names and sizes of the camera's files."""
        listed = [
            f"{file.path.name} {file.size_bytes}"
            for kind in ("rgb", "depth")
            for file in self._files(clip, camera, kind).values()
        ]
        return "\n".join([clip, self._calibration(clip).text, *listed])

    def paths(self, clip: str, camera: int, frame: int) -> tuple[str | None, str | None]:
        """Return the paths of the image and the depth, relative to the root; None without."""
        rgb, depth = (self._path(clip, camera, kind, frame) for kind in ("rgb", "depth"))
        found = (path.relative_to(self.root).as_posix() if path.is_file() else None
                 for path in (rgb, depth))  # fmt: skip
        image_path, points_path = found
        return image_path, points_path

    def faults(self, clip: str, camera: int, frame: int) -> tuple[str | None, str | None]:
        """Return what is wrong with a frame, and what with its image alone; None for nothing."""
        error = _fault(self._path(clip, camera, "depth", frame), self.view(clip, camera).camera)
        image_error = _fault(self._path(clip, camera, "rgb", frame), self.view(clip, camera).camera)
        return error, image_error

    def view(self, clip: str, camera: int) -> View:
        """Return a camera, its level frame and the world; raises DatasetError."""
        return self._calibration(clip).views[camera]

    def scene(self, clip: str) -> Scene | None:
        """Return the labelled objects; None without labels.

        Raises:
            DatasetError: the file is broken, or ends before the clip does.
        """
        path = self._clip(clip) / TRUTH
        if not path.is_file():
            return None
        last = max(
            (n for camera in range(self.cameras(clip)) for n in self.numbers(clip, camera)),
            default=-1,
        )
        return read_scene(path, self._calibration(clip).frames_per_second, last + 1)

    def depth(self, clip: str, camera: int, frame: int) -> FloatArray:
        """Return (H, W) depth in metres, 0 where there is none; raises FrameError."""
        path = self._path(clip, camera, "depth", frame)
        steps = read_grey16(path)
        self._check_size(path, steps.shape, clip, camera)
        return steps * self._calibration(clip).depth_unit_m

    def image(self, clip: str, camera: int, frame: int) -> ImageArray:
        """Return (H, W, 3) RGB; raises FrameError."""
        path = self._path(clip, camera, "rgb", frame)
        image = read_rgb(path)
        self._check_size(path, image.shape, clip, camera)
        return image

    def _check_size(self, path: Path, shape: tuple[int, ...], clip: str, camera: int) -> None:
        expected = self.view(clip, camera).camera
        if shape[:2] != (expected.height_px, expected.width_px):
            raise FrameError(
                f"{path}: {shape[1]}x{shape[0]} pixels; its calibration says "
                f"{expected.width_px}x{expected.height_px}"
            )

    def _clip(self, clip: str) -> Path:
        return Path(self.root) / clip

    def _path(self, clip: str, camera: int, kind: str, frame: int) -> Path:
        path = image_file(self._clip(clip), camera, kind, frame)
        if path.is_file():
            return path
        # Numbers may be written with other than six digits.
        found = self._files(clip, camera, kind).get(frame)
        return found.path if found else path

    def _files(self, clip: str, camera: int, kind: str) -> dict[int, DataFile]:
        return numbered_files(self._clip(clip) / f"camera_{camera}" / kind, ".png")

    def _calibration(self, clip: str) -> Calibration:
        path = self._clip(clip) / CALIBRATION
        try:
            changed_ns = path.stat().st_mtime_ns
        except OSError as error:
            raise DatasetError(f"{path}: cannot be read: {error.strerror}") from error
        return _read_calibration(path, changed_ns)


def camera_json(view: View) -> dict[str, Any]:
    """Return a camera as calibration.json has it."""
    matrix = view.camera.matrix
    return {
        "width_px": view.camera.width_px,
        "height_px": view.camera.height_px,
        "intrinsics_px": [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]],
        "world_T_camera": inverse(view.world_to_camera).tolist(),
    }


def image_file(clip: Path, camera: int, kind: str, frame: int) -> Path:
    """Return where an image of kind rgb or depth lies."""
    return clip / f"camera_{camera}" / kind / f"{frame:06d}.png"


@lru_cache(maxsize=16)
def _read_calibration(path: Path, changed_ns: int) -> Calibration:  # noqa: ARG001
    try:
        text = path.read_text(encoding="utf-8")
        values = json.loads(text)
        rate, unit = float(values["frames_per_second"]), float(values["depth_unit_m"])
        views = tuple(_view(entry) for entry in values["cameras"])
    except KeyError as error:
        raise DatasetError(f"{path}: {error} is missing") from error
    except (OSError, TypeError, ValueError, OverflowError) as error:
        raise DatasetError(f"{path}: {error}") from error
    if not views or not (0 < rate < math.inf and 0 < unit < math.inf):
        raise DatasetError(
            f"{path}: it needs a camera, and frames_per_second and depth_unit_m above 0"
        )
    return Calibration(text, rate, unit, views)


def _view(entry: dict[str, Any]) -> View:
    fx, fy, cx, cy = (float(value) for value in entry["intrinsics_px"])
    pose = np.asarray(entry["world_T_camera"], dtype=np.float64).reshape(4, 4)
    rotation = pose[:3, :3]
    rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) and np.isfinite(pose).all()
    if not rigid or np.linalg.det(rotation) < 0:
        raise ValueError("a camera's world_T_camera is no rigid pose")
    width_px, height_px = int(entry["width_px"]), int(entry["height_px"])
    if not (np.isfinite([fx, fy, cx, cy]).all() and min(fx, fy, width_px, height_px) > 0):
        raise ValueError("a camera's sizes and focal lengths must be above 0, its centre finite")
    camera = Camera(
        projection=((fx, 0.0, cx, 0.0), (0.0, fy, cy, 0.0), (0.0, 0.0, 1.0, 0.0)),
        width_px=width_px,
        height_px=height_px,
    )
    return level_view(camera, pose)


def _fault(path: Path, camera: Camera) -> str | None:
    """Return what is wrong with an image, in one line, without decoding it."""
    if not path.is_file():
        return f"no {path.parent.name} image {path.name}; fetch it again"
    try:
        size = png_size(path)
    except FrameError as error:
        return f"{path.parent.name} {error}"
    if size != (camera.width_px, camera.height_px):
        return f"{path.parent.name} image {path.name} is {size[0]}x{size[1]}, unlike its camera"
    return None
