from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tcrdata.evidence import voxels


def packed(*cells: tuple[int, int, int]) -> np.ndarray:
    return np.unique(voxels.keys(np.array(cells, dtype=np.int64).reshape(-1, 3)))


def test_points_fall_into_the_voxel_below_them_on_both_sides_of_the_origin() -> None:
    xyz = np.array([(0.1, -0.1, 0.3), (-0.01, 0.0, 0.25)], np.float32)
    np.testing.assert_array_equal(voxels.voxel_indices(xyz, 0.25), [(0, -1, 1), (-1, 0, 1)])


@given(st.lists(st.tuples(*[st.integers(-(2**20), 2**20 - 1)] * 3), min_size=1, max_size=20))
@settings(max_examples=50, deadline=None)
def test_keys_name_voxels_and_keep_their_order(cells: list[tuple[int, int, int]]) -> None:
    array = np.array(cells, dtype=np.int64)
    np.testing.assert_array_equal(voxels.from_keys(voxels.keys(array)), array)
    ordered = array[np.lexsort(array.T[::-1])]
    assert (np.diff(voxels.keys(ordered)) >= 0).all()


def test_faces_edges_and_corners_connect() -> None:
    cells = packed((0, 0, 0), (1, 1, 1), (2, 1, 1), (5, 0, 0), (-3, 0, 0))
    np.testing.assert_array_equal(
        voxels.from_keys(cells), [(-3, 0, 0), (0, 0, 0), (1, 1, 1), (2, 1, 1), (5, 0, 0)]
    )
    np.testing.assert_array_equal(voxels.components(cells), [0, 1, 1, 1, 2])


def test_nothing_has_no_components() -> None:
    assert len(voxels.components(packed())) == 0


def test_a_long_chain_is_one_component() -> None:
    cells = packed(*[(i, i % 2, -i) for i in range(500)])
    assert voxels.components(cells).max() == 0


def test_touching_grows_by_one_voxel() -> None:
    static = packed((0, 0, 0))
    asked = voxels.keys(np.array([(1, -1, 1), (0, 0, 0), (2, 0, 0), (0, 0, -2)], np.int64))
    np.testing.assert_array_equal(voxels.touching(asked, static), [True, True, False, False])
    assert not voxels.touching(asked, packed()).any()
