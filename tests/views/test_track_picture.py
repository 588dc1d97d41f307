"""The clip from above: objects that stand still stay in place while the camera drives."""

from __future__ import annotations

import numpy as np

from tcrdata.views.canvas import png_image
from tcrdata.views.palette import TRACKS
from tcrdata.views.track_picture import _moved, track_picture


def drive(frames: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 2, 3] = np.arange(frames)
    return poses


def test_a_parked_car_stays_where_it_is() -> None:
    boxes = np.array([[3.0, 1.0, 20.0 - n, 4.0, 2.0, 1.5, -1.2] for n in range(6)])
    moved = _moved(drive(6), boxes)
    np.testing.assert_allclose(moved, np.tile(moved[0], (6, 1)), atol=1e-12)


def test_heading_turns_with_the_camera() -> None:
    turned = np.eye(4)[None].copy()
    turned[0, :3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # a quarter turn: yaw + pi/2
    box = np.array([[1.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.3]])
    moved = _moved(turned, box)[0]
    np.testing.assert_allclose(moved[:3], [0, 0, -1], atol=1e-12)
    assert np.isclose(moved[6], 0.3 + np.pi / 2)


def test_picture_shows_its_tracks() -> None:
    boxes = np.array([[3.0, 1.0, 10.0, 4.0, 2.0, 1.5, 0.1]] * 5)
    data = track_picture(drive(20), {"a": (np.arange(5), boxes)}, "a drive")
    assert data == track_picture(drive(20), {"a": (np.arange(5), boxes)}, "a drive")
    picture = png_image(data).astype(int)
    wanted = np.array([int(TRACKS[0][i : i + 2], 16) for i in (1, 3, 5)])
    assert (np.abs(picture - wanted).max(axis=2) < 20).sum() > 50
