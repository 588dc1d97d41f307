"""The path of a depth camera: each frame is registered to a keyframe (small_gicp, point to plane).

A flat table pins down neither a slide nor a turn on it, and noise alone makes registration wander.
So the pose of the frame before is a hypothesis as well: when as many points agree with it as with
the registration, the camera has not moved as far as the depth can tell, and the pose stays. All
poses refer to the keyframe, so that a slow motion adds up until the points show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tcrdata.types import Float32Array, FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Distances within three standard deviations, told from their median: 3 / 0.6745.
_NOISE_FACTOR = 4.45


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
        support_share: float,
        overlap_share: float,
    ) -> None:
        """Start without a keyframe.

        Args:
            voxel_m: frames are thinned to one point a voxel.
            gate_m: points farther from the keyframe than this do not count.
            support_share: the pose before stays unless the registration has more than this share
                of the points on its side in addition.
            overlap_share: a new keyframe is made when fewer points than this have a partner.
        """
        self._voxel_m = voxel_m
        self._gate_m = gate_m
        self._support_share = support_share
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
        gaps, gaps_before = self._gaps(key, registered, points), self._gaps(key, before, points)
        # Agreement is counted, not averaged: whatever moves by itself must not pull the camera.
        near_m = _NOISE_FACTOR * float(np.median(gaps))
        gain = float((gaps <= near_m).mean() - (gaps_before <= near_m).mean())
        if gain <= self._support_share:
            registered, gaps = before, gaps_before
        self._keyframe_T_level = registered
        world_T_level = key.world_T_level @ registered
        if np.isfinite(gaps).mean() < self._overlap_share:
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

        pose = self._keyframe_T_level
        for gate_m in (self._gate_m, self._gate_m / 4):
            pose = small_gicp.align(
                key.cloud,
                cloud,
                key.tree,
                init_T_target_source=pose,
                registration_type="PLANE_ICP",
                max_correspondence_distance=gate_m,
                num_threads=1,
            ).T_target_source
        return np.array(pose)

    def _gaps(self, key: _Keyframe, keyframe_T_level: FloatArray, points: FloatArray) -> FloatArray:
        """Return (N,) distances to the planes of the keyframe; infinite without one in the gate."""
        moved = points @ keyframe_T_level[:3, :3].T + keyframe_T_level[:3, 3]
        found = key.search.query(moved, distance_upper_bound=self._gate_m)
        partner = np.asarray(found[1])
        paired = np.isfinite(np.asarray(found[0]))
        gaps = np.full(len(points), np.inf)
        offsets = moved[paired] - key.points[partner[paired]]
        gaps[paired] = np.abs((offsets * key.normals[partner[paired]]).sum(axis=1))
        return gaps


def _keyframe(cloud: Any, tree: Any, world_T_level: FloatArray) -> _Keyframe:
    from scipy.spatial import cKDTree

    points = np.asarray(cloud.points())[:, :3]
    normals = np.asarray(cloud.normals())[:, :3]
    return _Keyframe(cloud, tree, points, normals, cKDTree(points), world_T_level)
