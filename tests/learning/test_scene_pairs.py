"""Pairs of generated scenes: what their flow says is what their images show."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tcrdata import registry
from tcrdata.errors import DatasetError, SettingsError
from tcrdata.learning.flow_recipes import plan_on_generated
from tcrdata.learning.flow_samples import GeneratedSamples
from tcrdata.learning.scene_pairs import FIRST_SEED, ROOTS, SceneSettings, scene_pair
from tcrdata.learning.textured_planes import FlowPair, PlaneSettings, textured_planes

CLEAN = PlaneSettings(height_px=128, width_px=160, brightness=0.0, noise=0.0)
SEEDS = range(2)


def pairs(dataset: str) -> Iterator[FlowPair]:
    for seed in SEEDS:
        own = SceneSettings(datasets=(dataset,), frames=12, moving=1.0)
        yield scene_pair(own, CLEAN, np.random.default_rng(seed))


@pytest.mark.parametrize("dataset", sorted(ROOTS))
def test_the_second_image_shows_what_the_flow_says(dataset: str) -> None:
    moving = 0
    for pair in pairs(dataset):
        assert pair.first.shape == pair.second.shape == (128, 160, 3)
        rows, columns = np.indices(pair.known.shape, dtype=np.float32)
        ends = np.dstack([columns, rows]) + pair.flow
        warped = cv2.remap(pair.second, ends, None, cv2.INTER_LINEAR)
        inside = (ends >= 0).all(axis=2) & (ends[..., 0] < 159) & (ends[..., 1] < 127)
        seen = inside & pair.known & (np.linalg.norm(pair.flow, axis=2) > 1)
        moved = np.abs(pair.first - pair.second)[seen]
        left = np.abs(pair.first - warped)[seen]
        if seen.sum() > 100:
            moving += 1
            assert np.mean(left) < np.mean(moved)
    assert moving


def test_flow_too_long_to_be_seen_in_a_piece_is_not_known() -> None:
    own = SceneSettings(datasets=("street",), frames=25, apart=24, fastest_mps=40.0)
    found = [scene_pair(own, CLEAN, np.random.default_rng(seed)) for seed in SEEDS]
    assert not all(pair.known.all() for pair in found)
    for pair in found:
        assert np.linalg.norm(pair.flow[pair.known], axis=-1).max(initial=0) <= 80
        assert np.isfinite(pair.flow).all()


def test_the_same_numbers_draw_the_same_pair() -> None:
    draws = [scene_pair(SceneSettings(), CLEAN, np.random.default_rng(5)) for _ in range(2)]
    for one, other in zip(*draws, strict=True):
        np.testing.assert_array_equal(one, other)


def test_scenes_of_low_seeds_are_left_to_those_who_score(monkeypatch: pytest.MonkeyPatch) -> None:
    for root in ROOTS.values():
        name = root.format(seed=FIRST_SEED, frames=2, speed=1.0)
        assert int(re.findall(r"seed=(\d+)", name)[0]) == FIRST_SEED > 100
    drawn: list[int] = []

    def opened(root: str) -> None:
        drawn.append(int(re.findall(r"seed=(\d+)", root)[0]))
        raise DatasetError("named is enough")

    monkeypatch.setattr(registry, "find", lambda *_: SimpleNamespace(open_dataset=opened))
    for seed in range(20):
        with pytest.raises(DatasetError):
            scene_pair(SceneSettings(), CLEAN, np.random.default_rng(seed))
    assert len(set(drawn)) == 20
    assert min(drawn) >= FIRST_SEED


def test_without_scenes_planes_are_drawn_as_before() -> None:
    sample = GeneratedSamples(CLEAN)({"key": "generated"}, np.random.default_rng(2))
    pair = textured_planes(CLEAN, np.random.default_rng(2))
    np.testing.assert_array_equal(sample["input"][0, :3], np.moveaxis(pair.first, 2, 0))


def test_larger_pairs_show_scenes_and_small_ones_do_not() -> None:
    row = {"model_id": "a", "settings": {"network": {"size": "small"}}}
    small, large = plan_on_generated("small", {}), plan_on_generated(None, {}, row)
    assert small.scenes.share == 0
    assert large.scenes.share > 0
    assert "scenes" not in small.identity("").settings
    assert "scenes" in large.identity("").settings
    none = plan_on_generated(None, {"scenes.share": "0"}, row)
    assert none.identity("").model_id != large.identity("").model_id


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"scenes.datasets": "kitti"}, "'kitti' is none of demo, cater, street"),
        ({"scenes.datasets": "()"}, "none is left"),
        ({"scenes.apart": "25"}, "a scene of 25 frames needs 1 to 24"),
    ],
)
def test_scenes_that_cannot_be_drawn_are_refused(values: dict[str, str], said: str) -> None:
    row = {"model_id": "a", "settings": {"network": {"size": "small"}}}
    with pytest.raises(SettingsError, match=said):
        plan_on_generated(None, values, row)
