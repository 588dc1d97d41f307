"""A chunk of frames of a table: depth averaged, cut into regions; several cameras laid together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import FrameError
from tcrdata.evidence.depth_frames import (
    AveragingSettings,
    averaged,
    depth_image,
    depth_noise,
    level_points,
)
from tcrdata.evidence.ground import Settings as PlaneSettings
from tcrdata.evidence.table_regions import (
    Region,
    RegionSettings,
    cut_regions,
    fused_regions,
    table_plane,
)
from tcrdata.geometry.transforms import transform_points
from tcrdata.types import Dataset, Float32Array, FloatArray, Frame, SeveralCameras


@dataclass(frozen=True)
class Chunk:
    """Frames `first` to `last - 1` of a window that holds their neighbours too.

    Attributes:
        dataset: reads the points.
        window: frames in order.
        first: place of the first that gives regions.
        last: place after the last that does.
        averaging: of the depth.
        regions: how they are cut out, metres scaled.
        plane: how the table is found, metres scaled.
        fuse_cameras: lay together what several cameras see, where the dataset has several.
    """

    dataset: Dataset
    window: tuple[Frame, ...]
    first: int
    last: int
    averaging: AveragingSettings
    regions: RegionSettings
    plane: PlaneSettings
    fuse_cameras: bool


@dataclass(frozen=True, eq=False)
class _Shot:
    """One frame: its depth, and the index of each pixel's point."""

    frame: Frame
    depth: Float32Array
    numbers: NDArray[np.int32]


@dataclass(frozen=True)
class _Camera:
    """What one camera saw in the window; a text where a frame cannot be read."""

    shots: tuple[_Shot | str, ...]
    noise_m: float
    level_T_camera_level: FloatArray

    def points(self, index: int, settings: AveragingSettings) -> FloatArray:
        """Return (H, W, 3) averaged points of a readable frame, in its own level frame."""
        shot = self.shots[index]
        assert isinstance(shot, _Shot)
        near = [
            other
            for other in self.shots
            if isinstance(other, _Shot)
            and abs(other.frame.frame - shot.frame.frame) <= settings.half_window_frames
        ]
        window = np.array([other.depth for other in near])
        depth = averaged(window, near.index(shot), self.noise_m, settings)
        points = level_points(depth, shot.frame)
        points[depth <= 0] = np.nan
        return points


def measure_chunk(chunk: Chunk) -> tuple[list[Region], list[tuple[int, str]]]:
    """Return the regions of a chunk's frames, and what is wrong with those that cannot be read."""
    own = _camera(chunk.dataset, chunk.window, np.eye(4))
    others = _other_cameras(chunk) if chunk.fuse_cameras else []
    regions: list[Region] = []
    errors: list[tuple[int, str]] = []
    for index in range(chunk.first, chunk.last):
        shot = own.shots[index]
        number = chunk.window[index].frame
        if isinstance(shot, str):
            errors.append((number, shot))
            continue
        points = own.points(index, chunk.averaging)
        plane = table_plane(points, chunk.plane)
        if plane is None:
            continue
        clouds = [_moved(other, index, chunk.averaging) for other in others]
        # Where the others show nothing, a part that is hidden from this camera is hidden.
        if any(map(len, clouds)):
            regions += fused_regions(number, points, shot.numbers, clouds, plane, chunk.regions)
        else:
            regions += cut_regions(number, points, shot.numbers, plane, chunk.regions)
    return regions, errors


def _other_cameras(chunk: Chunk) -> list[_Camera]:
    """Read the other cameras' frames of the same moments."""
    if not isinstance(chunk.dataset, SeveralCameras):
        return []
    moments = [chunk.dataset.simultaneous(frame) for frame in chunk.window]
    return [
        _camera(chunk.dataset, [frame for frame, _ in seen], seen[0][1])
        for seen in zip(*moments, strict=True)
    ]


def _moved(camera: _Camera, index: int, settings: AveragingSettings) -> FloatArray:
    """Return (N, 3) points of another camera in the level frame; none where it cannot be read."""
    if isinstance(camera.shots[index], str):
        return np.empty((0, 3))
    points = camera.points(index, settings).reshape(-1, 3)
    known = points[np.isfinite(points[:, 0])]
    return np.asarray(transform_points(camera.level_T_camera_level, known), dtype=np.float64)


def _camera(dataset: Dataset, frames: Sequence[Frame], level_T_other: FloatArray) -> _Camera:
    shots = tuple(_shot(dataset, frame) for frame in frames)
    noise_m = depth_noise([shot.depth for shot in shots if isinstance(shot, _Shot)])
    return _Camera(shots, noise_m, level_T_other)


def _shot(dataset: Dataset, frame: Frame) -> _Shot | str:
    """Return a frame's depth image, or why it cannot be read."""
    try:
        if frame.status != "ok":
            raise FrameError(str(frame.error))
        cloud = dataset.read_points(frame)
    except FrameError as error:
        return str(error)
    if frame.camera is None or cloud.pixels is None:
        return f"frame {frame.frame} has no depth image"
    depth = depth_image(cloud, frame)
    numbers = np.full(depth.shape, -1, dtype=np.int32)
    numbers[cloud.pixels[:, 1], cloud.pixels[:, 0]] = np.arange(len(cloud), dtype=np.int32)
    return _Shot(frame, depth, numbers)
