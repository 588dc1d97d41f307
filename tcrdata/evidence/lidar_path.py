"""The path of a LiDAR by KISS-ICP (Vizzo et al., RA-L 2023), one sweep after another."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcrdata.types import Float32Array, FloatArray


class LidarPath:
    """Registers sweeps to the map of those before; constant velocity predicts the next."""

    def __init__(
        self, *, furthest_m: float, voxel_m: float, voxel_points: int, convergence: float
    ) -> None:
        """Start with an empty map.

        Args:
            furthest_m: the map keeps what is this near.
            voxel_m: side of the map's voxels.
            voxel_points: most points a voxel keeps.
            convergence: registration ends with a smaller step (m, rad).
        """
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        config = KISSConfig()
        config.data.deskew = False
        config.data.min_range = 0.0
        config.data.max_range = furthest_m
        config.mapping.voxel_size = voxel_m
        config.mapping.max_points_per_voxel = voxel_points
        config.registration.convergence_criterion = convergence
        # Threads would add up in another order on every run.
        config.registration.max_num_threads = 1
        self._odometry: Any = KissICP(config)

    def add(self, xyz: Float32Array, interval: float) -> FloatArray:
        """Register the next sweep.

        Args:
            xyz: (N, 3) points without ground, level frame.
            interval: time since the last sweep over the time between the two before it.

        Returns:
            (4, 4) world_T_level; the world is the level frame of the first sweep.
        """
        if abs(interval - 1.0) > 0.5:
            self._odometry.last_delta = motion_power(self._odometry.last_delta, interval)
        self._odometry.register_frame(xyz.astype(np.float64), np.empty(0))
        return np.array(self._odometry.last_pose)


def motion_power(motion: FloatArray, exponent: float) -> FloatArray:
    """Return a (4, 4) motion made longer or shorter: its rotation vector and translation."""
    from scipy.spatial.transform import Rotation

    result = np.eye(4)
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    result[:3, :3] = Rotation.from_rotvec(turn * exponent).as_matrix()
    result[:3, 3] = motion[:3, 3] * exponent
    return result
