"""Compiled passes give the very bits of the array expressions that they stand for."""

from __future__ import annotations

import numpy as np
from block_world import to_box
from scipy.ndimage import gaussian_filter
from scipy.optimize import linear_sum_assignment

from tcrdata.geometry.boxes import points_in_box
from tcrdata.tracking.assignment import cheapest
from tcrdata.tracking.cell_points import cell_points, near, number_inside
from tcrdata.tracking.near_points import blurred, unit_directions, unit_rows
from tcrdata.tracking.templates import BLUR

RANDOM = np.random.default_rng(5)


def test_a_blur_is_scipys() -> None:
    for shape in ((3, 3, 3, 2), (9, 4, 7, 5)):
        values = RANDOM.standard_normal(shape).astype(np.float32)
        expected = gaussian_filter(values, (1, 1, 1, 0), mode="constant", truncate=2.0)
        np.testing.assert_array_equal(blurred(values, BLUR), expected)


def test_points_near_a_box_are_those_inside_its_half_sizes() -> None:
    points = RANDOM.uniform(-3, 3, (2000, 3)).astype(np.float32)
    box = np.array([0.3, -0.2, 0.5, 2.0, 1.0, 1.5, 0.7])
    half = np.array([1.2, 0.9, 0.7])
    local = to_box(points.astype(np.float64), box)
    inside = np.flatnonzero((np.abs(local) <= half).all(axis=1))
    cells = cell_points(points)
    found, places = near(box, cells, half)
    np.testing.assert_array_equal(found, inside)
    np.testing.assert_allclose(places, local[inside], rtol=0, atol=1e-15)


def test_few_points_far_ones_and_none_are_counted_in_a_box() -> None:
    box = np.array([0.3, -0.2, 0.5, 2.0, 1.0, 1.5, 0.7])
    points = RANDOM.uniform(-2, 2, (500, 3)).astype(np.float32)
    outlier = np.array([[4e5, 0, -3e5]], np.float32)
    for own in (points, np.concatenate([points, outlier]), points[:1], points[:0], outlier):
        assert number_inside(cell_points(own), box) == points_in_box(own, box).sum()
    nowhere = np.full(7, np.nan)
    assert number_inside(cell_points(points), nowhere) == 0


def test_rows_get_length_one_and_nothing_stays_nothing() -> None:
    rows = unit_rows(np.array([[3.0, 4.0], [0.0, 0.0]]))
    np.testing.assert_array_equal(rows, np.array([[0.6, 0.8], [0.0, 0.0]], np.float32))


def test_the_cheapest_assignment_is_scipys() -> None:
    for share in (0.1, 0.5):
        cost = np.where(RANDOM.random((7, 5)) < share, RANDOM.random((7, 5)), 1e3)
        rows, columns = linear_sum_assignment(cost)
        kept = cost[rows, columns] < 1e3
        assert cheapest(cost) == (rows[kept].tolist(), columns[kept].tolist())


def test_directions_have_the_length_of_rows_with_their_columns() -> None:
    angles = RANDOM.uniform(0, np.pi, 200).astype(np.float32)
    c, s = np.cos(angles), np.sin(angles)
    expected = unit_rows(np.column_stack([np.full(len(angles), 1.5), c, s]))
    np.testing.assert_array_equal(unit_directions(c, s, 1.5), expected)
