"""The points of a sequence's frames in the axes of a LiDAR: x forward, y left, z up."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tcrdata import registry
from tcrdata.errors import FrameError
from tcrdata.exporters.labels import SequenceLabels
from tcrdata.geometry.transforms import inverse, transform_points
from tcrdata.store.table_arrays import matrices
from tcrdata.types import Dataset, Float32Array, FloatArray, Frame, PointCloud

_LIDAR_T_LEVEL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


def lidar_poses(part: SequenceLabels) -> FloatArray:
    """Return (F, 4, 4) `lidar_T_level` of every frame.

    The LiDAR's own frame; a depth camera's points get a LiDAR's axes at the camera's place,
    level with the ground.
    """
    poses = matrices(part.frames, "level_T_sensor", (4, 4))
    lidar = part.frames["sensor"][0].as_py() == "lidar"
    own = lidar & ~np.isnan(poses).any(axis=(1, 2))
    result = np.broadcast_to(_LIDAR_T_LEVEL, poses.shape).copy()
    for row in np.flatnonzero(own):
        repeated = row > 0 and own[row - 1] and np.array_equal(poses[row], poses[row - 1])
        result[row] = result[row - 1] if repeated else inverse(poses[row])
    return result


def lidar_boxes(boxes: FloatArray, lidar_T_level: FloatArray) -> FloatArray:
    """Turn boxes of the level frame into those of the LiDAR's.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw.
        lidar_T_level: (N, 4, 4).

    Returns:
        (N, 7) x, y, z of the geometric centre, length, width, height, and the heading in
        (-pi, pi]: 0 along x, pi/2 along y. With a LiDAR aligned to the camera it is
        -(pi/2 + rotation_y).
    """
    rotation, shift = lidar_T_level[:, :3, :3], lidar_T_level[:, :3, 3]
    yaw = boxes[:, 6]
    forward = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    forward = np.einsum("nij,nj->ni", rotation, forward)
    center = np.einsum("nij,nj->ni", rotation, boxes[:, :3]) + shift
    return np.column_stack([center, boxes[:, 3:6], np.arctan2(forward[:, 1], forward[:, 0])])


class FramePoints:
    """The points of one sequence, read one frame at a time; rows are those of its frames."""

    def __init__(self, part: SequenceLabels) -> None:
        self._part = part
        self._numbers: list[int] = part.frames["frame"].to_pylist()
        self._poses = lidar_poses(part)

    def read(self, row: int) -> Float32Array:
        """Return (N, 4) x, y, z (m, the LiDAR's frame) and reflectance in [0, 1].

        Raises:
            FrameError: the points are gone since the build, or cannot be read.
        """
        cloud = self._cloud(row)
        xyz = transform_points(self._poses[row], cloud.xyz.astype(np.float64))
        return np.column_stack([xyz, cloud.reflectance]).astype(np.float32)

    def level(self, row: int) -> FloatArray:
        """Return (N, 3) x, y, z (m) in the level frame, as a proposal's `point_indices` count them.

        Raises:
            FrameError: the points are gone since the build, or cannot be read.
        """
        return self._cloud(row).xyz.astype(np.float64)

    def _cloud(self, row: int) -> PointCloud:
        number = self._numbers[row]
        if number not in self._frames:
            raise FrameError(
                f"frame {number} of '{self._part.sequence}' is gone from {self._part.root} since "
                "the build: put it back, or add --labels-only"
            )
        return self._dataset.read_points(self._frames[number])

    @cached_property
    def _dataset(self) -> Dataset:
        module = registry.find("datasets", self._part.dataset)
        opened: Dataset = module.open_dataset(self._part.root)
        return opened

    @cached_property
    def _frames(self) -> dict[int, Frame]:
        return {frame.frame: frame for frame in self._dataset.frames(self._part.sequence)}
