from __future__ import annotations

import numpy as np
import pytest
from plane_world import PROJECTION, frame, motion

from tcrdata.errors import FrameError
from tcrdata.evidence.point_flow import (
    PixelIndex,
    ends,
    index_points,
    nearest_pixels,
    projection_of,
    rigid_flow,
)
from tcrdata.types import Frame, PointCloud

CAMERA = np.array(PROJECTION, dtype=float)


def cloud(*xyz: tuple[float, float, float], pixels: np.ndarray | None = None) -> PointCloud:
    return PointCloud(np.array(xyz, np.float32), np.zeros(len(xyz), np.float32), pixels)


def index(points: PointCloud, near_m: float = 1.0) -> PixelIndex:
    return index_points(points, CAMERA, 160, 120, near_m)


def test_the_nearest_point_of_a_pixel_hides_the_others() -> None:
    found = index(cloud((0, 0, 20), (0, 0, 5), (1, 0, 10), (0, 0, 5)))
    np.testing.assert_array_equal(found.points, [1, 2])  # of equals the first
    np.testing.assert_array_equal(found.columns, [80, 90])
    np.testing.assert_array_equal(found.rows, [60, 60])
    assert found.grid[60, 80] == 1
    assert (found.grid >= 0).sum() == 2


def test_points_near_behind_and_outside_have_no_pixel() -> None:
    found = index(cloud((0, 0, 0.9), (0, 0, -5), (30, 0, 10), (0, 30, 10), (0, 0, 0)))
    assert len(found.points) == 0


def test_a_depth_camera_says_itself_which_pixels_its_points_are() -> None:
    pixels = np.array([[3, 4], [7, 8]], np.int32)
    found, _ = nearest_pixels(cloud((0, 0, 5), (1, 0, 5), pixels=pixels), CAMERA)
    np.testing.assert_array_equal(found, pixels)


def test_a_flow_needs_a_point_at_both_ends() -> None:
    start = index(cloud((0, 0, 10), (1, 0, 10), (2, 0, 10)))
    end = index(cloud((0.5, 0, 10), (1.25, 0, 10)))  # columns 85 and 92 or 93
    flow = np.zeros((120, 160, 2), np.float32)
    flow[60, 80] = (5.4, -0.4)
    flow[60, 90] = (8.0, 0.0)
    flow[60, 100] = (500.0, 0.0)
    np.testing.assert_array_equal(ends(start, end, flow), [0, -1, -1])


def test_the_egomotion_of_a_point_gives_its_flow() -> None:
    points = np.array([(0, 0, 10), (1, 0, 10), (0, 0, -3)], np.float32)
    flow = rigid_flow(points, motion(x=0.5), CAMERA, CAMERA)
    np.testing.assert_allclose(flow[:2], [(5, 0), (5, 0)], atol=1e-5)
    assert np.isnan(flow[2]).all()


def test_a_frame_without_a_camera_says_so() -> None:
    shown = frame(3)
    bare = Frame("plane", "a", 3, 0, None, shown.camera_T_level, shown.level_T_sensor)
    with pytest.raises(FrameError, match="frame 3"):
        projection_of(bare)
