"""Points and boxes in a LiDAR's axes, whatever sensor they come from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from kitti_tree import LEVEL_T_SENSOR
from label_worlds import frame_row, label_row, make_store, sequence_row

from tcrdata.exporters.frame_points import lidar_boxes, lidar_poses
from tcrdata.exporters.labels import ExportOptions, SequenceLabels, chosen_labels
from tcrdata.geometry.transforms import inverse

NAMES = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
PLACE = dict(zip(NAMES, (1.0, 0.5, 8.0, 4.0, 2.0, 1.5, 0.0), strict=True))


def part_of(sensor: str) -> SequenceLabels:
    store = make_store(
        f"frame_points_{sensor}",
        sequences=[sequence_row("0000", sensor)],
        frames=[frame_row("0000", 0) | {"level_T_sensor": LEVEL_T_SENSOR.ravel().tolist()}],
        labels=[label_row("0000", 0, "p", 0.5, **PLACE)],
    )
    with chosen_labels(store, "s1", ExportOptions()) as chosen:
        return next(chosen.sequences())


def test_a_lidar_keeps_its_own_frame_and_a_depth_camera_gets_level_axes() -> None:
    np.testing.assert_allclose(lidar_poses(part_of("lidar"))[0], inverse(LEVEL_T_SENSOR))
    turned = lidar_poses(part_of("depth"))[0] @ np.array([1.0, 0.5, 8.0, 1.0])
    np.testing.assert_allclose(turned, [8.0, -1.0, -0.5, 1.0])


@pytest.mark.parametrize("rotation_y", [-3.0, -math.pi / 2, 0.0, 0.7, 3.1])
def test_the_heading_is_minus_a_right_angle_minus_rotation_y(rotation_y: float) -> None:
    box = np.array([[1.0, 0.5, 8.0, 4.0, 2.0, 1.5, rotation_y]])
    (found,) = lidar_boxes(box, lidar_poses(part_of("depth")))
    expected = -(math.pi / 2 + rotation_y)
    assert math.isclose(math.cos(found[6] - expected), 1.0, abs_tol=1e-12)
    np.testing.assert_allclose(found[:6], [8.0, -1.0, -0.5, 4.0, 2.0, 1.5])
