from __future__ import annotations

import cv2
import numpy as np
import pytest

from tcrdata.errors import SettingsError
from tcrdata.learning.textured_planes import PlaneSettings, textured_planes

CLEAN = PlaneSettings(height_px=64, width_px=96, brightness=0.0, noise=0.0, still=0.0)


def test_the_second_image_shows_what_the_flow_says() -> None:
    for seed in range(4):
        pair = textured_planes(CLEAN, np.random.default_rng(seed))
        rows, columns = np.indices(pair.known.shape, dtype=np.float32)
        ends = np.dstack([columns, rows]) + pair.flow
        warped = cv2.remap(pair.second, ends, None, cv2.INTER_LINEAR)
        inside = (ends >= 0).all(axis=2) & (ends[..., 0] < 95) & (ends[..., 1] < 63)
        moved = np.abs(pair.first - pair.second)[inside]
        left = np.abs(pair.first - warped)[inside]
        assert np.median(left) < 0.3 * np.median(moved)
        assert np.percentile(np.linalg.norm(pair.flow, axis=2), 90) > 1


def test_a_background_that_stands_has_no_flow() -> None:
    own = PlaneSettings(height_px=64, width_px=96, planes=0, still=1.0)
    assert not textured_planes(own, np.random.default_rng(0)).flow.any()


def test_plain_planes_hardly_differ_from_pixel_to_pixel() -> None:
    spreads = []
    for plain in (0.0, 1.0):
        own = PlaneSettings(64, 96, planes=0, plain=plain, brightness=0.0, noise=0.0)
        images = [textured_planes(own, np.random.default_rng(seed)).first for seed in range(8)]
        spreads.append(np.mean([image.std(axis=(0, 1)) for image in images]))
    assert spreads[1] < 0.35 * spreads[0]


def test_the_same_numbers_draw_the_same_pair() -> None:
    one, other = (textured_planes(PlaneSettings(), np.random.default_rng(3)) for _ in range(2))
    for first, second in zip(one, other, strict=True):
        np.testing.assert_array_equal(first, second)
    assert one.first.shape == (128, 192, 3)
    assert one.first.min() >= 0
    assert one.first.max() <= 1


def test_an_image_too_small_to_learn_from_is_refused() -> None:
    with pytest.raises(SettingsError, match="64 px"):
        PlaneSettings(height_px=32)
