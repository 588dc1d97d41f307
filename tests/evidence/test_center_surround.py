from __future__ import annotations

import numpy as np
import pytest

from tcrdata.evidence.center_surround import center_surround, chi_square, histogram, shell


def test_the_last_bin_is_open() -> None:
    shares = histogram(np.array([0.05, 0.15, 0.15, 99.0]), 0.1, 4)
    np.testing.assert_allclose(shares, [0.25, 0.5, 0, 0.25])


def test_chi_square_is_nought_for_equal_and_one_for_disjoint_histograms() -> None:
    a, b = np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.0, 1.0])
    assert chi_square(a, a) == 0
    assert chi_square(a, b) == pytest.approx(1)
    # (0.5 - 0.25)^2 / 0.75 + (0.5 - 0.75)^2 / 1.25, halved.
    expected = 0.5 * 0.25**2 * (1 / 0.75 + 1 / 1.25)
    assert chi_square(a, np.array([0.25, 0.75, 0])) == pytest.approx(expected)


def test_a_moving_patch_stands_out_and_a_piece_of_a_uniform_field_does_not() -> None:
    random = np.random.default_rng(0)
    center = np.arange(1000) < 200
    around = ~center
    still = random.uniform(0, 0.1, 1000)
    patch = np.where(center, random.uniform(0.5, 1.0, 1000), still)
    assert center_surround(patch, center, around, 0.1, 16) > 0.95
    uniform = random.uniform(0.5, 1.0, 1000)
    assert center_surround(uniform, center, around, 0.1, 16) < 0.05


def test_without_a_surround_there_is_nothing_to_compare() -> None:
    motion = np.ones(5)
    every, none = np.ones(5, bool), np.zeros(5, bool)
    assert center_surround(motion, every, none, 0.1, 16) is None
    assert center_surround(motion, none, every, 0.1, 16) is None


def test_the_shell_is_near_the_box_and_not_of_the_region() -> None:
    box = np.array([0, 0, 10, 4, 2, 2, 0.0])
    xyz = np.array([(0, 0, 10), (2.5, 0, 10), (3.5, 0, 10), (0, 1.9, 11.9), (0, 2.1, 10)])
    region = np.array([True, False, False, False, False])
    np.testing.assert_array_equal(shell(xyz, region, box, 1.0), [False, True, False, True, False])
