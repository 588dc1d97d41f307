"""The first step of a path: a drive may begin at any speed, ahead or, seen backwards, behind."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.datasets.street import open_dataset
from tcrdata.evidence.lidar_path import LidarPath


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
