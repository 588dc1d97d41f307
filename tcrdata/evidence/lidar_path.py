"""The path of a LiDAR by KISS-ICP (Vizzo et al., RA-L 2023), one sweep after another.

The steps are those of the library's compiled core. Its Python layer says the same around readers
of configuration files, whose import takes longer than the registration of five sweeps.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcrdata.evidence.alignment import shares_with_neighbour
from tcrdata.types import Float32Array, FloatArray

# What the library has by default.
FIRST_THRESHOLD_M, LEAST_MOTION_M, MOST_ITERATIONS = 2.0, 0.1, 500

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
        self._odometry = _Odometry(furthest_m, voxel_m, voxel_points, convergence)
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
        self._odometry.register(xyz.astype(np.float64))
        return np.array(self._odometry.last_pose)

    def _first_motion(self, before: Float32Array, now: Float32Array) -> FloatArray:
        """Return the straight way along z on which the second sweep best meets the first.

        Of equal ones the shortest.
        """
        last = round(self._first_step_m / self._first_spacing_m)
        steps = sorted(range(-last, last + 1), key=lambda number: (abs(number), number))
        sample = now[::FIRST_STRIDE]
        ways = [np.array([0, 0, n * self._first_spacing_m], dtype=np.float32) for n in steps]
        moved = (sample + way for way in ways)
        found = shares_with_neighbour(moved, before, 0.6 * self._first_spacing_m)
        shares = [share or 0.0 for share in found]
        motion = np.eye(4)
        motion[2, 3] = steps[int(np.argmax(shares))] * self._first_spacing_m
        return motion


class _Odometry:
    """One sweep after another is registered to the map of those before it.

    Attributes:
        last_pose: (4, 4) world_T_level of the last sweep.
        last_delta: (4, 4) its motion since the sweep before, by which the next is predicted.
    """

    def __init__(
        self, furthest_m: float, voxel_m: float, voxel_points: int, convergence: float
    ) -> None:
        from kiss_icp.pybind import kiss_icp_pybind as core

        # Threads would add up in another order on every run.
        threads = 1
        self._core: Any = core
        self._voxel_m = voxel_m
        self._near: Any = core._Preprocessor(furthest_m, 0.0, False, threads)
        self._threshold: Any = core._AdaptiveThreshold(
            FIRST_THRESHOLD_M, LEAST_MOTION_M, furthest_m
        )
        self._registration: Any = core._Registration(MOST_ITERATIONS, convergence, threads)
        self._map: Any = core._VoxelHashMap(voxel_m, furthest_m, voxel_points)
        self.last_pose: FloatArray = np.eye(4)
        self.last_delta: FloatArray = np.eye(4)

    def register(self, xyz: FloatArray) -> None:
        """Register (N, 3) points, and add them to the map."""
        core = self._core
        near = self._near._preprocess(core._Vector3dVector(xyz), np.empty(0), self.last_delta)
        mapped = core._voxel_down_sample(near, self._voxel_m * 0.5)
        source = core._voxel_down_sample(mapped, self._voxel_m * 1.5)
        sigma = self._threshold._compute_threshold()
        guess = self.last_pose @ self.last_delta
        pose = self._registration._align_points_to_map(source, self._map, guess, 3 * sigma, sigma)
        self._threshold._update_model_deviation(np.linalg.inv(guess) @ pose)
        self._map._update(mapped, pose)
        self.last_delta = np.linalg.inv(self.last_pose) @ pose
        self.last_pose = pose


def motion_power(motion: FloatArray, exponent: float) -> FloatArray:
    """Return a (4, 4) motion made longer or shorter: its rotation vector and translation."""
    from scipy.spatial.transform import Rotation

    result = np.eye(4)
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    result[:3, :3] = Rotation.from_rotvec(turn * exponent).as_matrix()
    result[:3, 3] = motion[:3, 3] * exponent
    return result
