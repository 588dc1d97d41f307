"""The path of a LiDAR by KISS-ICP (Vizzo et al., RA-L 2023), one sweep after another."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcrdata.evidence.alignment import share_with_neighbour
from tcrdata.types import Float32Array, FloatArray

FIRST_STRIDE = 8
"""Of the second sweep every so manieth point is tried: thousands are left."""


class LidarPath:
    """Registers sweeps to the map of those before; constant velocity predicts the next."""

    def __init__(
        self,
        *,
        furthest_m: float,
        voxel_m: float,
        voxel_points: int,
        convergence: float,
        first_step_m: float,
        first_spacing_m: float,
    ) -> None:
        """Start with an empty map.

        Args:
            furthest_m: the map keeps what is this near.
            voxel_m: side of the map's voxels.
            voxel_points: most points a voxel keeps.
            convergence: registration ends with a smaller step (m, rad).
            first_step_m: the second sweep is tried up to this far ahead of the first, and behind
                it: a drive may begin at any speed, and registration finds only what is near.
            first_spacing_m: the places tried are this far apart.
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
        self._first_step_m = first_step_m
        self._first_spacing_m = first_spacing_m
        self._first_sweep: Float32Array | None = None
        self._sweeps = 0

    def add(self, xyz: Float32Array, interval: float) -> FloatArray:
        """Register the next sweep.

        Args:
            xyz: (N, 3) points without ground, level frame.
            interval: time since the last sweep over the time between the two before it.

        Returns:
            (4, 4) world_T_level; the world is the level frame of the first sweep.
        """
        if self._sweeps == 0:
            self._first_sweep = xyz
        elif self._sweeps == 1 and self._first_sweep is not None:
            self._odometry.last_delta = self._first_motion(self._first_sweep, xyz)
            self._first_sweep = None
        elif abs(interval - 1.0) > 0.5:
            self._odometry.last_delta = motion_power(self._odometry.last_delta, interval)
        self._sweeps += 1
        self._odometry.register_frame(xyz.astype(np.float64), np.empty(0))
        return np.array(self._odometry.last_pose)

    def _first_motion(self, before: Float32Array, now: Float32Array) -> FloatArray:
        """Return the straight way along z on which the second sweep best meets the first.

        Of equal ones the shortest.
        """
        last = round(self._first_step_m / self._first_spacing_m)
        steps = sorted(range(-last, last + 1), key=lambda number: (abs(number), number))
        sample = now[::FIRST_STRIDE]
        shares = []
        for number in steps:
            way = np.array([0, 0, number * self._first_spacing_m], dtype=np.float32)
            share = share_with_neighbour(sample + way, before, 0.6 * self._first_spacing_m)
            shares.append(share or 0.0)
        motion = np.eye(4)
        motion[2, 3] = steps[int(np.argmax(shares))] * self._first_spacing_m
        return motion


def motion_power(motion: FloatArray, exponent: float) -> FloatArray:
    """Return a (4, 4) motion made longer or shorter: its rotation vector and translation."""
    from scipy.spatial.transform import Rotation

    result = np.eye(4)
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    result[:3, :3] = Rotation.from_rotvec(turn * exponent).as_matrix()
    result[:3, 3] = motion[:3, 3] * exponent
    return result
