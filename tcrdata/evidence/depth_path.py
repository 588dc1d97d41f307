"""The path of a depth camera: each frame is registered to a keyframe (small_gicp, point to plane).

A flat table pins down neither a slide nor a turn on it, and noise alone makes registration wander.
So the pose of the frame before is a hypothesis as well: when its residual is as good as the
registration's, the camera has not moved as far as the depth can tell, and the pose stays. All
poses refer to the keyframe, so that a slow motion adds up until its residual shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tcrdata.types import Float32Array, FloatArray


@dataclass(frozen=True)
class _Keyframe:
    """A frame that later ones are registered to."""

    cloud: Any
    tree: Any
    points: FloatArray
    normals: FloatArray
    search: cKDTree
    world_T_level: FloatArray


class DepthPath:
    """Registers depth frames to keyframes."""

    def __init__(
        self,
        *,
        voxel_m: float,
        gate_m: float,
        residual_share: float,
        overlap_share: float,
    ) -> None:
        """Start without a keyframe.

        Args:
            voxel_m: frames are thinned to one point a voxel.
            gate_m: points farther from the keyframe than this do not count.
            residual_share: the pose before stays while its residual is at most this share larger
                than the registration's.
            overlap_share: a new keyframe is made when fewer points than this have a partner.
        """
        self._voxel_m = voxel_m
        self._gate_m = gate_m
        self._residual_share = residual_share
        self._overlap_share = overlap_share
        self._keyframe: _Keyframe | None = None
        self._keyframe_T_level = np.eye(4)

    def add(self, xyz: Float32Array, interval: float) -> FloatArray:
        """Register the next frame.

        Args:
            xyz: (N, 3) points, level frame.
            interval: not used: no velocity is assumed.

        Returns:
            (4, 4) world_T_level; the world is the level frame of the first frame.
        """
        del interval
        cloud, tree = self._preprocessed(xyz)
        if self._keyframe is None:
            self._keyframe = _keyframe(cloud, tree, np.eye(4))
            return np.eye(4)
        key, before = self._keyframe, self._keyframe_T_level
        points = np.asarray(cloud.points())[:, :3]
        registered = self._registered(key, cloud)
        overlap, residual = self._residual(key, registered, points)
        _, residual_before = self._residual(key, before, points)
        if residual_before <= residual * (1.0 + self._residual_share):
            registered = before
        self._keyframe_T_level = registered
        world_T_level = key.world_T_level @ registered
        if overlap < self._overlap_share:
            self._keyframe = _keyframe(cloud, tree, world_T_level)
            self._keyframe_T_level = np.eye(4)
        return np.asarray(world_T_level)

    def _preprocessed(self, xyz: Float32Array) -> tuple[Any, Any]:
        import small_gicp

        cloud, tree = small_gicp.preprocess_points(
            xyz.astype(np.float64), downsampling_resolution=self._voxel_m, num_threads=1
        )
        return cloud, tree

    def _registered(self, key: _Keyframe, cloud: Any) -> FloatArray:
        import small_gicp

        result = small_gicp.align(
            key.cloud,
            cloud,
            key.tree,
            init_T_target_source=self._keyframe_T_level,
            registration_type="PLANE_ICP",
            max_correspondence_distance=self._gate_m,
            num_threads=1,
        )
        return np.array(result.T_target_source)

    def _residual(
        self, key: _Keyframe, keyframe_T_level: FloatArray, points: FloatArray
    ) -> tuple[float, float]:
        """Return the share of points with a partner, and the mean square point-to-plane distance.

        Points without a partner within the gate count as the gate.
        """
        moved = points @ keyframe_T_level[:3, :3].T + keyframe_T_level[:3, 3]
        found = key.search.query(moved, distance_upper_bound=self._gate_m)
        distance, partner = np.asarray(found[0]), np.asarray(found[1])
        paired = np.isfinite(distance)
        squares = np.full(len(points), self._gate_m**2)
        gaps = moved[paired] - key.points[partner[paired]]
        squares[paired] = (gaps * key.normals[partner[paired]]).sum(axis=1) ** 2
        return float(paired.mean()), float(squares.mean())


def _keyframe(cloud: Any, tree: Any, world_T_level: FloatArray) -> _Keyframe:
    points = np.asarray(cloud.points())[:, :3]
    normals = np.asarray(cloud.normals())[:, :3]
    return _Keyframe(cloud, tree, points, normals, cKDTree(points), world_T_level)
