"""The first step of a path: a drive may begin at any speed, ahead or, seen backwards, behind."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.datasets.street import open_dataset
from tcrdata.evidence.lidar_path import LidarPath, _Odometry


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_a_path_may_begin_at_motorway_speed(order: tuple[int, ...]) -> None:
    drive = open_dataset("seed=3,speed_mps=30,frames=3,images=false")
    frames = drive.frames(drive.sequences()[0])
    path = LidarPath(
        furthest_m=80.0,
        voxel_m=1.0,
        voxel_points=10,
        convergence=5e-4,
        first_step_m=4.5,
        first_spacing_m=0.5,
    )
    places = []
    for number in order:
        xyz = drive.read_points(frames[number]).xyz
        standing = xyz[(xyz[:, 1] < 1.2) & (np.linalg.norm(xyz, axis=1) > 3.5)]
        places.append(path.add(standing, 1.0)[:3, 3])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps == pytest.approx([3.0, 3.0], abs=0.1)


def test_the_steps_are_the_librarys() -> None:
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.deskew, config.data.min_range, config.data.max_range = False, 0.0, 80.0
    config.mapping.voxel_size, config.mapping.max_points_per_voxel = 1.0, 10
    config.registration.convergence_criterion, config.registration.max_num_threads = 5e-4, 1
    theirs, ours = KissICP(config), _Odometry(80.0, 1.0, 10, 5e-4)
    drive = open_dataset("seed=3,frames=3,images=false")
    for frame in drive.frames(drive.sequences()[0]):
        xyz = drive.read_points(frame).xyz[::4].astype(np.float64)
        theirs.register_frame(xyz, np.empty(0))
        ours.register(xyz)
        np.testing.assert_array_equal(ours.last_pose, theirs.last_pose)
        np.testing.assert_array_equal(ours.last_delta, theirs.last_delta)
