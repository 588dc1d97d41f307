"""Boxes fitted, tested for members and overlapped, against shapes whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcrdata.geometry import boxes


def rectangle_outline(cx, cz, length, width, yaw, sides=(0, 1, 2, 3), step=0.1):
    """Points on chosen sides of a rectangle: 0 front, 1 right, 2 rear, 3 left."""
    along, across = (
        np.arange(-1, 1.0001, 2 * step / length),
        np.arange(-1, 1.0001, 2 * step / width),
    )
    local = {
        0: np.stack([np.full_like(across, 1.0), across], axis=1),
        2: np.stack([np.full_like(across, -1.0), across], axis=1),
        1: np.stack([along, np.full_like(along, 1.0)], axis=1),
        3: np.stack([along, np.full_like(along, -1.0)], axis=1),
    }
    points = np.concatenate([local[s] for s in sides]) * [length / 2, width / 2]
    c, s = math.cos(yaw), math.sin(yaw)
    return np.stack(
        [cx + c * points[:, 0] + s * points[:, 1], cz - s * points[:, 0] + c * points[:, 1]], axis=1
    )


def axis_error(a: float, b: float) -> float:
    return abs((a - b + math.pi / 2) % math.pi - math.pi / 2)


@pytest.mark.parametrize("yaw", [0.0, 0.3, -1.2, 1.5, math.pi / 2])
def test_min_area_box_recovers_a_full_rectangle(yaw):
    fit = boxes.min_area_box(rectangle_outline(3.0, 12.0, 4.2, 1.8, yaw))
    assert fit[:2] == pytest.approx((3.0, 12.0), abs=0.1)
    assert fit.length == pytest.approx(4.2, abs=0.12)
    assert fit.width == pytest.approx(1.8, abs=0.12)
    assert axis_error(fit.yaw_rad, yaw) < 0.05
    assert fit.fill_share > 0.95


@pytest.mark.parametrize("yaw", [0.1, 0.7, -0.9])
def test_l_shape_box_keeps_the_heading_of_two_sides(yaw):
    rng = np.random.default_rng(0)
    points = rectangle_outline(-4.0, 20.0, 4.0, 1.7, yaw, sides=(2, 3))
    points = points + rng.normal(0, 0.02, points.shape)
    assert axis_error(boxes.l_shape_box(points).yaw_rad, yaw) < math.radians(2.5)


def test_a_fit_is_never_wider_than_long_and_has_one_yaw_an_axis():
    for yaw in np.linspace(-3.2, 3.2, 33):
        for fit in (boxes.min_area_box, boxes.l_shape_box):
            box = fit(rectangle_outline(0, 10, 4, 2, yaw))
            assert box.length >= box.width
            assert -math.pi / 2 < box.yaw_rad <= math.pi / 2


@pytest.mark.parametrize(
    "points", [[[1.0, 5.0]], [[1.0, 5.0], [1.0, 5.0]], [[0, 0], [1, 1], [2, 2]]]
)
def test_degenerate_points_give_a_flat_box(points):
    for fit in (boxes.min_area_box, boxes.l_shape_box):
        box = fit(np.array(points, dtype=float))
        assert np.isfinite(box).all()
        assert box.width == pytest.approx(0, abs=1e-9) or fit is boxes.l_shape_box


def test_yaw_turns_from_x_towards_minus_z():
    corners = boxes.box_corners_bev(np.array([[0, 0, 0, 4.0, 0.2, 1, math.pi / 2]]))[0]
    front = corners[:2].mean(axis=0)
    assert front == pytest.approx((0.0, -2.0), abs=1e-9)


def test_points_in_box_agree_with_the_corners():
    rng = np.random.default_rng(1)
    box = np.array([2.0, 0.5, 9.0, 4.0, 1.6, 1.5, 0.8])
    xyz = rng.uniform([-2, -1.5, 5], [6, 2.5, 13], (4000, 3))
    inside = boxes.points_in_box(xyz, box)
    import shapely

    polygon = shapely.Polygon(boxes.box_corners_bev(box[None])[0])
    expected = shapely.contains_xy(polygon, xyz[:, 0], xyz[:, 2]) & (abs(xyz[:, 1] - 0.5) <= 0.75)
    assert np.array_equal(inside, expected)
    assert boxes.points_in_box(xyz, box, margin_m=0.5).sum() > inside.sum()


def test_edge_share_tells_a_shell_from_a_filled_blob():
    rng = np.random.default_rng(2)
    box = np.array([0, 0, 10, 4.0, 1.8, 1.5, 0.4])
    shell = rectangle_outline(0, 10, 4.0, 1.8, 0.4)
    filled = rng.uniform(-1, 1, (2000, 2)) * [2.0, 0.9]
    c, s = math.cos(0.4), math.sin(0.4)
    filled = filled @ np.array([[c, -s], [s, c]]) + [0, 10]
    assert boxes.edge_share(shell, box, 0.1) == 1.0
    assert boxes.edge_share(filled, box, 0.1) < 0.25
    assert boxes.edge_share(np.empty((0, 2)), box, 0.1) == 0.0


def test_bev_iou_of_known_overlaps():
    a = np.array([[0, 0, 0, 4.0, 2.0, 1, 0.0], [0, 0, 0, 2.0, 2.0, 1, 0.0]])
    b = np.array(
        [
            [0, 5, 0, 4.0, 2.0, 9, math.pi],
            [2, 0, 0, 4.0, 2.0, 1, 0.0],
            [0, 0, 0, 2, 2, 1, math.pi / 4],
        ]
    )
    iou = boxes.bev_iou(a, b)
    assert iou[0] == pytest.approx([1.0, 1 / 3, 3.6569 / (8 + 4 - 3.6569)], abs=1e-3)
    assert iou[1, 2] == pytest.approx(3.3137 / (8 - 3.3137), abs=1e-3)
    assert boxes.bev_iou(a, np.empty((0, 7))).shape == (2, 0)
    assert boxes.bev_iou(a, b + np.array([50, 0, 0, 0, 0, 0, 0])).max() == 0.0
