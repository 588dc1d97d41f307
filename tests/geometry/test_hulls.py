"""The pixels of hulls, counted by hand."""

from __future__ import annotations

import numpy as np

from tcrdata.geometry.hulls import hull_pixels


def test_a_square_with_a_point_inside() -> None:
    found = hull_pixels(np.array([[2, 1], [5, 1], [2, 3], [5, 3], [3, 2]]), 8, 6)
    expected = np.zeros((6, 8), bool)
    expected[1:4, 2:6] = True
    np.testing.assert_array_equal(found, expected)


def test_one_pixel_and_a_line() -> None:
    assert np.argwhere(hull_pixels(np.array([[4, 2]]), 8, 6)).tolist() == [[2, 4]]
    line = hull_pixels(np.array([[1, 1], [3, 3]]), 8, 6)
    assert np.argwhere(line).tolist() == [[1, 1], [2, 2], [3, 3]]
