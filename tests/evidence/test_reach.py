"""Points within reach: as numpy's own steps choose them, to the last one."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.evidence.reach import solid_within


@pytest.mark.parametrize("nearest_m", [0.0, 3.5])
def test_solid_points_within_reach(nearest_m: float) -> None:
    random = np.random.default_rng(3)
    xyz = random.normal(0, 30, (5000, 3)).astype(np.float32)
    xyz[:4] = [[3.5, 0, 1], [1, 80, 2], [np.nan, 0, 0], [1, 0, 1]]
    sensor, ground = np.array([0.0, 0.0, 1.0]), random.random(5000) < 0.4
    offsets = xyz - sensor.astype(np.float32)
    squares = np.einsum("ij,ij->i", offsets, offsets)
    kept = ~ground & (squares >= nearest_m**2) & (squares <= 80.0**2)
    found = solid_within(xyz, ground, sensor, nearest_m, 80.0)
    np.testing.assert_array_equal(found, np.flatnonzero(kept))
    assert 0 < len(found) < 5000


def test_no_points() -> None:
    none = np.empty((0, 3), np.float32)
    assert solid_within(none, np.empty(0, bool), np.zeros(3), 0.0, 80.0).shape == (0,)
