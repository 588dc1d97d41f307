"""p of a frame, paths scored in it, and what the library makes of paths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from block_world import FLOOR_M, block, passing, scene

from tcrdata.tracking.library import (
    LibrarySettings,
    basic_library,
    entry_starts,
    joined,
    library_of_rows,
    normalised,
)
from tcrdata.tracking.long_range import Volume, make_volume, sample, score_paths
from tcrdata.tracking.scenes import look


def test_p_is_one_in_objects_and_out_of_sight_and_zero_in_free_space() -> None:
    """eq. 9: min(s * o + (1 - v), 1)."""
    shown = scene(0, passing(0), ("still",))
    inside, behind, free, outside = (
        passing(0)["still"][:3],
        np.array([0.0, 1.0, 11.0]),
        np.array([0.0, 1.0, 6.0]),
        np.array([0.0, 1.0, -5.0]),
    )
    places = np.array([inside, behind, free, outside])
    volume = make_volume(shown, places[:3], 0.25, 0.2)
    np.testing.assert_allclose(sample(volume, places.astype(np.float32)), [1, 1, 0, 1], atol=0.02)


def test_without_a_grid_p_is_the_same_but_not_blurred() -> None:
    shown = scene(0, passing(0), ("still",))
    places = np.random.default_rng(1).uniform([-4, 0, 5], [4, FLOOR_M, 14], (300, 3))
    grid = make_volume(shown, places, 0.1, 0.2)
    bare = make_volume(shown, np.zeros((0, 3)), 0.1, 0.2)
    in_grid, beside = (sample(volume, places.astype(np.float32)) for volume in (grid, bare))
    assert np.mean(np.abs(in_grid - beside)) < 0.05
    assert in_grid.max() == beside.max() == 1.0


def test_heat_is_what_the_networks_say() -> None:
    shown = scene(0, passing(0), ("still",))
    faint = shown.candidates.heat
    faint[:] = 0.4
    place = passing(0)["still"][:3].copy()
    place[2] -= 0.45  # in the front of the box, in sight
    bare = make_volume(shown, np.zeros((0, 3)), 0.1, 0.2)
    assert sample(bare, place[None].astype(np.float32))[0] == pytest.approx(0.4)


def test_paths_are_scored_step_by_step_in_the_volume_of_that_frame() -> None:
    shown = scene(0, {})
    values = [np.full((4, 4, 4), p, np.float32) for p in (1.0, 0.5, 0.0)]
    volumes = [Volume(v, np.zeros(3), 1.0, shown, 0.2) for v in values]
    paths = np.random.default_rng(2).uniform(0.1, 2.9, (5, 3, 3)).astype(np.float32)
    np.testing.assert_allclose(score_paths(paths, volumes), 0.5, atol=1e-6)
    with pytest.raises(ValueError, match="3 steps need as many volumes, not 2"):
        score_paths(paths, volumes[:2])


def test_trilinear_by_hand() -> None:
    values = np.zeros((2, 2, 2), np.float32)
    values[1, 1, 1] = 1.0
    volume = Volume(values, np.zeros(3), 2.0, scene(0, {}), 0.2)
    assert sample(volume, np.array([[1.0, 0.5, 1.5]], np.float32))[0] == pytest.approx(
        0.5 * 0.25 * 0.75
    )


def test_visible_share_of_a_box_behind_a_wall() -> None:
    view = scene(0, passing(0)).view
    clear, hidden = block(4.5, 10.0, yaw=0.4), block(0.0, 12.0)
    assert look(view, clear, 0.2).visible_share == 1.0
    assert look(view, hidden, 0.2).visible_share < 0.2
    assert look(view, block(0.0, -6.0), 0.2).visible_share == 0.0


def test_a_normalised_path_oriented_again_is_the_path() -> None:
    boxes = np.array([[2.0 + 0.3 * t, 1.0, 5.0 + 0.4 * t, 4, 2, 1.5, 0.3 + 0.01 * t]
                      for t in range(8)])  # fmt: skip
    steps, turns, first = normalised(boxes)
    assert first == pytest.approx(0.5)
    np.testing.assert_allclose(steps[:, 0], 0.5 * np.arange(1, 8))
    np.testing.assert_allclose(steps[:, 1:], 0.0, atol=1e-12)
    row = {"along_m": steps[:, 0], "down_m": steps[:, 1], "across_m": steps[:, 2],
           "turn_rad": turns, "first_step_m": first, "metric_scale": 1.0}  # fmt: skip
    library = library_of_rows([row], 1.0)
    places, yaws, apart = library.oriented(boxes[0], np.array([0.3, 0.0, 0.4]))
    np.testing.assert_allclose(places[0], boxes[1:, :3], atol=1e-5)
    np.testing.assert_allclose(yaws[0], boxes[1:, 6], atol=1e-5)
    assert apart[0] == pytest.approx(0.0)
    turned, _, _ = library.oriented(boxes[0], np.array([0.0, 0.0, -0.5]))
    np.testing.assert_allclose(turned[0][:, 2], 5.0 - 0.5 * np.arange(1, 8), atol=1e-5)


def test_paths_of_another_scale_and_length_are_fitted_in() -> None:
    rows = [
        {"along_m": [1.0, 2.0], "down_m": [0.0, 0.0], "across_m": [0.0, 0.0],
         "turn_rad": [0.0, 0.0], "first_step_m": 1.0, "metric_scale": 1.0},
        {"along_m": [0.5], "down_m": [0.0], "across_m": [0.0], "turn_rad": [0.0],
         "first_step_m": 0.5, "metric_scale": 0.5},
    ]  # fmt: skip
    library = library_of_rows(rows, 0.5)
    np.testing.assert_allclose(library.steps[:, :, 0], [[0.5, 1.0], [0.5, 0.5]])
    whole = joined(basic_library(4, 0.2), library)
    assert whole.steps.shape == (4, 4, 3)
    np.testing.assert_allclose(whole.steps[1, :, 0], 0.2 * np.arange(1, 5))
    assert len(library_of_rows([], 1.0)) == 0


def test_entries_hold_no_gap_and_are_not_too_short() -> None:
    frames = np.array([0, 1, 2, 3, 4, 5, 6, 9, 10])
    own = LibrarySettings(stride_frames=3, fewest_frames=4, most_frames=5)
    assert entry_starts(frames, own) == [(0, 6), (3, 7)]
    assert entry_starts(frames[:1], own) == []


def test_a_box_that_turns_keeps_its_path() -> None:
    boxes = np.array([[0.2 * t, 1, 5, 4, 2, 1.5, math.pi - 0.1 + 0.05 * t] for t in range(8)])
    boxes[:, 6] = np.arctan2(np.sin(boxes[:, 6]), np.cos(boxes[:, 6]))
    _, turns, _ = normalised(boxes)
    np.testing.assert_allclose(turns, 0.05 * np.arange(1, 8))
