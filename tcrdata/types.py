"""The frozen dataclasses and protocols that flow between the parts.

Frames of reference:
    camera: x right, y down, z forward; for KITTI the rectified camera 0, as its labels have it.
    level: the camera's origin, turned so that y points down along gravity; KITTI's cameras are
        mounted level, so there level = camera. Points, boxes and egomotion are in the level frame.
    sensor: the LiDAR's own axes (x forward, y left, z up), or the depth camera's (= camera).

`a_T_b` takes points from b to a: `p_a = a_T_b @ p_b`. Metres, radians, int64 nanoseconds.
A box is (x, y, z, length, width, height, yaw): its geometric centre, its size, and its yaw about
the level y axis with KITTI's sense: the heading is (cos yaw, 0, -sin yaw) in (x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ImageArray = NDArray[np.uint8]

Sensor = Literal["lidar", "depth"]
BOX_COLUMNS = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
"""Columns of a row that make its box, in order."""

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        projection: (3, 4) row-major tuple of tuples; camera frame (m) to homogeneous pixels.
        width_px: image width.
        height_px: image height.
    """

    projection: tuple[tuple[float, ...], ...]
    width_px: int
    height_px: int

    @property
    def matrix(self) -> FloatArray:
        """The projection as a (3, 4) array."""
        return np.asarray(self.projection, dtype=np.float64)


@dataclass(frozen=True)
class Frame:
    """One camera frame, before any pixel or point is read: one row of `frames`.

    Attributes:
        dataset: the dataset's name.
        sequence: the drive or clip.
        frame: number of the frame, 0-based, as the dataset counts (gaps stay gaps).
        timestamp_ns: UTC.
        camera: None when neither an image nor a calibration of its size is known.
        camera_T_level: (4, 4) as tuples.
        level_T_sensor: (4, 4) as tuples.
        image_path: relative to the dataset's root; None when there is no image.
        points_path: sweep or depth image, relative to the root; None when generated.
        status: `ok`, or `error` when the frame cannot be used at all.
        error: why, in one line.
        image_error: why the image cannot be used while the points can; None when it can.
    """

    dataset: str
    sequence: str
    frame: int
    timestamp_ns: int
    camera: Camera | None
    camera_T_level: tuple[tuple[float, ...], ...]
    level_T_sensor: tuple[tuple[float, ...], ...]
    image_path: str | None = None
    points_path: str | None = None
    status: Literal["ok", "error"] = "ok"
    error: str | None = None
    image_error: str | None = None

    @property
    def sensor_matrix(self) -> FloatArray:
        """`level_T_sensor` as a (4, 4) array."""
        return np.asarray(self.level_T_sensor, dtype=np.float64)

    @property
    def level_projection(self) -> FloatArray | None:
        """(3, 4): level frame (m) to homogeneous pixels; None without a camera."""
        if self.camera is None:
            return None
        return self.camera.matrix @ np.asarray(self.camera_T_level, dtype=np.float64)

    @property
    def has_image(self) -> bool:
        """Whether an image can be read for this frame."""
        return self.camera is not None and self.image_error is None


@dataclass(frozen=True)
class SequenceInfo:
    """One drive or clip: one row of `sequences`.

    Attributes:
        dataset: the dataset's name.
        sequence: the drive or clip.
        root: where the dataset lies; paths of frames are relative to it.
        sensor: `lidar` or `depth`.
        metric_scale: metres of this world a metre of a road scene: every metric setting and rule
            bound is multiplied by it (1 for KITTI; 0.2 for a tabletop).
        static_camera: the camera is known not to move.
        calibration: where the calibration came from.
        fingerprint: sha256 over calibration text and names and sizes of the files, never labels.
        number_of_frames: frames from the first to the last, missing and unreadable ones included.
    """

    dataset: str
    sequence: str
    root: str
    sensor: Sensor
    metric_scale: float
    static_camera: bool
    calibration: str
    fingerprint: str
    number_of_frames: int


@dataclass(frozen=True)
class PointCloud:
    """The points of one frame, in the sensor's order.

    Attributes:
        xyz: (N, 3) float32, metres, level frame; all finite.
        reflectance: (N,) float32 in [0, 1]; zeros for a depth camera.
        pixels: (N, 2) int32 (column, row) of each point for a depth camera; None for LiDAR.
    """

    xyz: Float32Array
    reflectance: Float32Array
    pixels: NDArray[np.int32] | None = None

    def __len__(self) -> int:
        return len(self.xyz)


class Dataset(Protocol):
    """What a dataset adapter offers: a light, picklable handle that reads lazily."""

    name: str
    root: str

    def sequences(self) -> list[str]:
        """Names of the drives or clips, sorted."""
        ...

    def info(self, sequence: str) -> SequenceInfo:
        """The sequence's row; raises DatasetError when it cannot be read at all."""
        ...

    def frames(self, sequence: str) -> list[Frame]:
        """Every frame in order; unreadable ones with status `error`."""
        ...

    def read_points(self, frame: Frame) -> PointCloud:
        """The frame's points; raises FrameError."""
        ...

    def read_image(self, frame: Frame) -> ImageArray:
        """The frame's (H, W, 3) RGB image; raises FrameError."""
        ...

    def ground_truth(self, sequence: str) -> list[dict[str, Any]]:
        """Rows of `ground_truth`; empty when there are no labels. Raises DatasetError."""
        ...


@runtime_checkable
class SeveralCameras(Protocol):
    """What a dataset offers besides when several of its sequences show one scene at once."""

    def simultaneous(self, frame: Frame) -> list[tuple[Frame, FloatArray]]:
        """The other cameras' frames of that moment, each with `level_T_other_level` (4, 4)."""
        ...


@dataclass(frozen=True)
class Generation:
    """A dataset that is generated.

    Attributes:
        root: what to open it with.
        steps: number of steps of the work.
        work: what has to be done before it can be opened, a step an item.
    """

    root: str
    steps: int
    work: Iterator[None]


class Tables(Protocol):
    """The rows that earlier stages left for one sequence and round."""

    def read(self, table: str, columns: Sequence[str] | None = None, **equals: Any) -> Any:
        """A pyarrow Table of this sequence, rows filtered by `column == value`."""
        ...


class Map(Protocol):
    """Ordered, bounded, maybe parallel map; the function and its items must pickle."""

    def __call__(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Yield `function(item)` in the order of the items."""
        ...


@dataclass(frozen=True)
class CueInput:
    """All that a cue gets to work on one sequence.

    Attributes:
        info: the sequence.
        frames: frames with status `ok` that this build asked for, in order.
        dataset: reads points and images.
        tables: what earlier stages wrote.
        settings: the cue's own frozen settings.
        parallel: maps a module-level function over items, in order.
        round: EM round, 1-based.
    """

    info: SequenceInfo
    frames: tuple[Frame, ...]
    dataset: Dataset
    tables: Tables
    settings: Any
    parallel: Map
    round: int = 1


@dataclass(frozen=True)
class Rows:
    """A batch of rows that a cue yields for one table.

    Attributes:
        table: a table of `schemas/`.
        columns: column name to a list or array, all of one length; keys that a schema has and a
            batch lacks become NULL; `dataset`, `sequence` and `round` are filled in.
    """

    table: str
    columns: dict[str, Any] = field(default_factory=dict)
