"""Pictures: the same bytes each time, the right layout, and colours where they belong."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tcrdata.views.birds_eye import Extent, Votes, fitting_extent, vote_classes
from tcrdata.views.canvas import png_image
from tcrdata.views.palette import SEEN_THROUGH, STYLES
from tcrdata.views.scene_picture import contact_sheet, frame_picture

PROJECTION = np.array([[700.0, 0, 600, 0], [0, 700.0, 180, 0], [0, 0, 1, 0]])
BOXES = {
    "labels": np.array([[-3.0, 1.0, 15.0, 4.0, 1.8, 1.5, -1.5]]),
    "truth": np.array([[-3.1, 1.0, 15.2, 4.2, 1.8, 1.5, -1.6]]),
    "rejected": np.empty((0, 7)),
}


def sweep(behind: bool = True) -> np.ndarray:
    random = np.random.default_rng(0)
    low = (-30, -2, -30 if behind else 3)
    return random.uniform(low, (30, 2, 40), (3000, 3)).astype(np.float32)


def votes(count: int, free: int) -> Votes:
    return Votes(np.full(count, free), np.ones(count, dtype=np.int64))


def colour(text: str) -> np.ndarray:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)])


def pixels_near(picture: np.ndarray, text: str) -> int:
    return int((np.abs(picture.astype(int) - colour(text)).max(axis=2) < 12).sum())


def test_same_drawing_same_bytes_without_metadata() -> None:
    points = sweep()
    image = np.full((360, 1200, 3), 90, dtype=np.uint8)
    first, second = (
        frame_picture(image, points, votes(3000, 2), BOXES, PROJECTION, title="a frame")
        for _ in range(2)
    )
    assert first == second
    for chunk in (b"tEXt", b"iTXt", b"tIME"):
        assert chunk not in first


@pytest.mark.parametrize(
    ("shape", "stacked"), [((360, 1200, 3), True), ((240, 320, 3), False), (None, True)]
)
def test_layout_follows_the_image(shape: tuple[int, ...] | None, stacked: bool) -> None:
    image = None if shape is None else np.full(shape, 90, dtype=np.uint8)
    data = frame_picture(image, sweep(), None, BOXES, PROJECTION, extent=Extent(-15, 15, -5, 45))
    width, height = struct.unpack(">II", data[16:24])
    assert width == 1660
    assert (height > 1000) == stacked


def test_votes_and_labels_show_in_their_colours() -> None:
    points = sweep()
    moved, still = (
        png_image(frame_picture(None, points, votes(3000, free), BOXES, None)) for free in (5, 0)
    )
    assert pixels_near(moved, SEEN_THROUGH) > pixels_near(still, SEEN_THROUGH) + 300
    assert pixels_near(still, STYLES["labels"].color) > 100
    without = png_image(frame_picture(None, points, None, {}, None))
    assert pixels_near(without, STYLES["labels"].color) == 0


def test_vote_classes() -> None:
    classes = vote_classes(Votes(np.array([0, 0, 2, 3], np.uint8), np.array([0, 4, 2, 1])), 4)
    assert classes.tolist() == [0, 1, 1, 2]
    assert vote_classes(None, 2).tolist() == [0, 0]


def test_extent_of_a_sweep_and_of_a_camera() -> None:
    assert fitting_extent(sweep(), BOXES, 1.0).z_min < 0
    around = fitting_extent(sweep(behind=False), BOXES, 0.2)
    assert around.z_min > 10
    assert around.x_max < 0
    assert fitting_extent(sweep(behind=False), {}, 0.2).depth > 10
    assert fitting_extent(np.empty((0, 3)), {}, 0.5).z_max == 22.5


def test_contact_sheet_places_pictures_in_rows() -> None:
    tile = frame_picture(None, sweep(), None, {}, None, extent=Extent(-5, 5, 0, 40))
    height, width = png_image(tile).shape[:2]
    sheet = png_image(contact_sheet([tile, tile, tile], columns=2, gap_px=10))
    assert sheet.shape == (2 * height + 10, 2 * width + 10, 3)
    np.testing.assert_array_equal(sheet[height + 10 :, :width], png_image(tile))
