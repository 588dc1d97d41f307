"""Wire frames on a box whose corners can be worked out by hand."""

from __future__ import annotations

import numpy as np

from tcrdata.views.overlays import corners_3d, wire_frame

PROJECTION = np.array([[100.0, 0, 50, 0], [0, 100.0, 50, 0], [0, 0, 1, 0]])


def test_corners_start_with_the_front() -> None:
    # Straight ahead: the front is the far side.
    corners = corners_3d(np.array([[0.0, 1.0, 10.0, 4.0, 2.0, 1.5, -np.pi / 2]]))[0]
    assert np.allclose(corners[[0, 1, 4, 5], 2], 12.0)
    assert np.allclose(corners[:4, 1], 1.75)
    assert np.allclose(corners[4:, 1], 0.25)


def test_wire_frame_has_twelve_edges_between_projected_corners() -> None:
    corners = corners_3d(np.array([[0.0, 0.0, 10.0, 2.0, 2.0, 2.0, 0.0]]))[0]
    edges = wire_frame(corners, PROJECTION)
    assert edges.shape == (12, 2, 2)
    assert np.isclose(edges.min(), 50 - 100 / 9)
    assert np.isclose(edges.max(), 50 + 100 / 9)


def test_edges_are_cut_at_the_camera() -> None:
    through = corners_3d(np.array([[0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 0.0]]))[0]
    edges = wire_frame(through, PROJECTION)
    assert len(edges) == 8  # four of the far side, four that come through
    assert np.isfinite(edges).all()
    behind = corners_3d(np.array([[0.0, 0.0, -5.0, 2.0, 2.0, 2.0, 0.0]]))[0]
    assert len(wire_frame(behind, PROJECTION)) == 0
