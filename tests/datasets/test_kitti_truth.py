from __future__ import annotations

import math

import numpy as np
import pytest

from tcrdata.datasets.kitti_labels import LabelledObject
from tcrdata.datasets.kitti_truth import image_box, speeds, truth_row
from tcrdata.types import Camera

CAMERA = Camera(((100.0, 0, 50.0, 0), (0, 100.0, 25.0, 0), (0, 0, 1.0, 0)), 101, 51)


def label(frame: int, x: float = 0.0, z: float = 10.0, object_id: str = "0") -> LabelledObject:
    return LabelledObject(frame, object_id, "Car", 0.0, 0.0, (x, 0, z, 4, 2, 1.5, 0.3), None)


def test_a_box_projects_by_its_nearest_corners() -> None:
    # Heading along z: 2 m wide and 1 m high, its front face 8 m away.
    found = image_box((0.0, 0.0, 10.0, 4.0, 2.0, 1.0, -math.pi / 2), CAMERA)
    assert found == pytest.approx((37.5, 18.75, 62.5, 31.25))


def test_a_box_is_cut_at_the_image_s_edges() -> None:
    found = image_box((6.0, 0.0, 10.0, 4.0, 4.0, 20.0, 0.0), CAMERA)
    assert found == pytest.approx((50 + 100 * 4 / 12, 0.0, 100.0, 50.0))


def test_a_box_beside_the_camera_reaches_to_the_edge() -> None:
    found = image_box((2.0, 0.0, 1.0, 2.0, 4.0, 1.0, 0.0), CAMERA)
    assert found is not None
    assert found[2] == 100.0
    assert found[0] == pytest.approx(50 + 100 / 3)


@pytest.mark.parametrize("centre", [(0.0, -10.0), (-30.0, 10.0), (30.0, 10.0), (0.0, -1.0)])
def test_a_box_out_of_the_image_has_no_image_box(centre: tuple[float, float]) -> None:
    assert image_box((centre[0], 0.0, centre[1], 2.0, 1.0, 1.0, 0.0), CAMERA) is None


def test_the_rotation_s_columns_are_length_height_width() -> None:
    row = truth_row(label(3), 1.5)
    rotation = np.array(row["level_R_object"]).reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 0], [math.cos(0.3), 0.0, -math.sin(0.3)])
    np.testing.assert_allclose(rotation[:, 1], [0.0, 1.0, 0.0])
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert row["object_size_m"] == [4, 1.5, 2]
    assert row["speed_mps"] == 1.5


def pose(x: float, yaw: float = 0.0) -> np.ndarray:
    """World to level: level z is the world's x, turned by a yaw about the world's z."""
    result = np.eye(4)
    c, s = math.cos(yaw), math.sin(yaw)
    axes = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    result[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ axes
    result[0, 3] = x
    return result


def test_speed_is_over_the_ground() -> None:
    times = {frame: 0.1 * frame for frame in range(8)}
    poses = {frame: pose(0.5 * frame) for frame in range(8)}
    ahead = [label(frame, z=20.0, object_id="ahead") for frame in range(8)]
    parked = [label(frame, z=20.0 - 0.5 * frame, object_id="parked") for frame in range(8)]
    found = speeds([*ahead, *parked], poses, times)
    assert len(found) == 16
    for (name, _), speed in found.items():
        assert speed == pytest.approx(5.0 if name == "ahead" else 0.0, abs=1e-9)


def test_a_turn_of_the_camera_is_no_motion() -> None:
    times = {frame: 0.1 * frame for frame in range(5)}
    poses = {frame: pose(0.0, 0.1 * frame) for frame in range(5)}
    still = [
        label(frame, x=20 * math.sin(0.1 * frame), z=20 * math.cos(0.1 * frame))
        for frame in range(5)
    ]
    assert max(speeds(still, poses, times).values()) < 1e-9


def test_jitter_of_the_labels_is_smoothed() -> None:
    times = {frame: 0.1 * frame for frame in range(20)}
    poses = {frame: pose(0.0) for frame in range(20)}
    jitter = np.random.default_rng(0).normal(0.0, 0.03, 20)
    found = speeds([label(f, z=20.0 + jitter[f]) for f in range(20)], poses, times)
    inner = [found["0", frame] for frame in range(3, 17)]
    assert max(inner) < 0.3


def test_frames_without_pose_time_or_neighbour_have_no_speed() -> None:
    times = {0: 0.0, 1: 0.1, 9: 0.9}
    poses = {0: pose(0), 1: pose(0), 2: pose(0), 9: pose(0)}
    found = speeds([label(f) for f in (0, 1, 2, 3, 9)], poses, times)
    assert sorted(frame for _, frame in found) == [0, 1]
