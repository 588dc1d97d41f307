"""2D boxes of 3D boxes against a camera whose answer can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.geometry.box_projection import box_corners, project_boxes

CAMERA = np.array([[100.0, 0, 50, 0], [0, 100, 40, 0], [0, 0, 1, 0]])


def test_a_box_ahead_projects_by_its_front_face():
    boxes = np.array([[0, 0, 10.0, 2.0, 2.0, 1.0, 0.0]])
    seen = project_boxes(boxes, CAMERA, 100, 80)
    assert seen.left_px[0] == pytest.approx(50 - 100 / 9)
    assert seen.right_px[0] == pytest.approx(50 + 100 / 9)
    assert seen.bottom_px[0] == pytest.approx(40 + 50 / 9)
    assert (seen.center_u_px[0], seen.center_v_px[0]) == pytest.approx((50, 40))
    assert seen.truncated_share[0] == pytest.approx(0)


def test_the_image_cuts_a_box_and_says_how_much():
    width = 2 * 100 / 9
    boxes = np.array([[-4.5, 0, 10.0, 2.0, 2.0, 1.0, 0.0]])
    seen = project_boxes(boxes, CAMERA, 100, 80)
    assert seen.left_px[0] == 0
    assert 0 < seen.truncated_share[0] < 1
    assert seen.right_px[0] == pytest.approx(50 - 350 / 11)
    assert width > seen.right_px[0]


def test_behind_is_nan_and_crossing_the_camera_is_cut():
    boxes = np.array([[0, 0, -10.0, 2, 2, 1, 0], [0.5, 0, 0.0, 2, 2, 1, 0]])
    seen = project_boxes(boxes, CAMERA, 100, 80)
    assert np.isnan(seen.left_px[0])
    assert np.isnan(seen.truncated_share[0])
    assert np.isfinite([seen.left_px[1], seen.right_px[1], seen.truncated_share[1]]).all()
    assert seen.truncated_share[1] > 0.9
    assert len(project_boxes(np.empty((0, 7)), CAMERA, 100, 80).left_px) == 0


def test_bottom_corners_come_first():
    corners = box_corners(np.array([[1.0, 2.0, 3.0, 4.0, 2.0, 1.0, 0.3]]))[0]
    assert corners[:4, 1] == pytest.approx(2.5)
    assert corners[4:, 1] == pytest.approx(1.5)
    assert corners.mean(axis=0) == pytest.approx((1, 2, 3))
