"""What a student sees of a pair, and what its teacher says of that."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tcrdata.errors import SettingsError
from tcrdata.learning.flow_recipes import plan_finetuning
from tcrdata.learning.flow_samples import PairSettings, TaughtSamples
from tcrdata.learning.taught_flows import TaughtFlows
from tcrdata.networks.flow_losses import FlowLossSettings


class Teacher:
    """Says that all moves by (5, 0), and remembers what it saw, and how often it was asked."""

    method = "raft"

    def __init__(self) -> None:
        self.seen: tuple[np.ndarray, np.ndarray] | None = None
        self.asked = 0

    def both_ways(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.seen = first, second
        self.asked += 1
        flow = np.zeros((*first.shape[:2], 2), np.float32)
        flow[..., 0] = 5
        return flow, -flow


def pair_of(height: int = 90, width: int = 140) -> dict[str, object]:
    whole = np.random.default_rng(0).integers(0, 256, (height, width + 5, 3), dtype=np.uint8)
    return {"key": "a", "first": whole[:, 5:], "second": whole[:, :-5]}


def piece_of(sample: dict[str, np.ndarray]) -> np.ndarray:
    return sample["images"][:, :3, 8:-8, 8:-8]


OWN = PairSettings(height_px=64, width_px=72, margin_px=8, flip=False)
HIDING, SHOWING = FlowLossSettings(), FlowLossSettings(occlusion=0)


def samples(
    teacher: Teacher, losses: FlowLossSettings = SHOWING, own: PairSettings = OWN, kept: float = 2
) -> TaughtSamples:
    """With room for so many pairs of 90 x 140 px."""
    return TaughtSamples(own, TaughtFlows(teacher, losses, int(kept * 90 * 140 * 18)), losses)


def test_only_the_student_is_hidden_from() -> None:
    sample = samples(Teacher(), HIDING)(pair_of(), np.random.default_rng(1))
    covered = (sample["input"].reshape(2, 3, 64, 72) != piece_of(sample)).any(axis=1)
    assert covered.any()
    assert not covered.all()
    assert (covered.reshape(2, -1).any(axis=1)).sum() == 1
    number = int(covered[1].any())
    # Hidden in its own image; in the other one where the flow ends in a box.
    np.testing.assert_array_equal(sample["hidden"][number, 0] > 0, covered[number])
    shift = 5 if number == 1 else -5
    other = sample["hidden"][1 - number, 0] > 0
    rows, columns = np.nonzero(other)
    assert len(rows)
    assert covered[number][rows, columns + shift].all()
    np.testing.assert_array_equal(sample["taught"][0, 0], 5)
    assert sample["trusted"][0, 0, :, :60].all()


def test_without_occlusion_the_student_sees_the_piece_as_it_is() -> None:
    sample = samples(Teacher())(pair_of(), np.random.default_rng(1))
    np.testing.assert_array_equal(sample["input"].reshape(2, 3, 64, 72), piece_of(sample))
    assert not sample["hidden"].any()


def test_the_losses_say_which_pixels_of_the_teacher_are_trusted() -> None:
    class Unsure(Teacher):
        def both_ways(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            flow, back = super().both_ways(first, second)
            return flow, back + np.float32(2)

    def share(**settings: float) -> float:
        own = FlowLossSettings(occlusion=0, **settings)
        sample = samples(Unsure(), own)(pair_of(), np.random.default_rng(1))
        return float(sample["trusted"].mean())

    # |w + w''|^2 is 8, |w|^2 + |w''|^2 is 38.
    assert share() == 0
    assert share(cycle_slack_px=7) > 0.9
    assert share(cycle_share=0.25) > 0.9


def test_images_smaller_than_the_piece_are_continued_at_their_edges() -> None:
    sample = samples(Teacher())(pair_of(40, 50), np.random.default_rng(0))
    assert sample["images"].shape == (2, 4, 80, 88)
    np.testing.assert_array_equal(piece_of(sample)[0, :, 40:, 0].std(axis=1), 0)


def numbered_pair() -> dict[str, object]:
    """Images whose red is the row and whose green is the column."""
    rows, columns = np.indices((90, 140)).astype(np.uint8)
    image = np.stack([rows, columns, rows], axis=2)
    return {"key": "a", "first": image, "second": image}


class Counting(Teacher):
    """Says of each pixel where it is."""

    def both_ways(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        super().both_ways(first, second)
        rows, columns = np.indices(first.shape[:2], np.float32)
        places = np.stack([columns, rows], axis=2)
        return places, -places


@pytest.mark.parametrize("seed", range(8))
def test_what_the_teacher_says_is_cut_where_the_images_are(seed: int) -> None:
    own = replace(OWN, flip=True)
    sample = samples(Counting(), own=own)(numbered_pair(), np.random.default_rng(seed))
    rows, columns = np.rint(255 * piece_of(sample)[0, :2])
    turned = -1 if columns[0, 0] > columns[0, 1] else 1
    np.testing.assert_array_equal(sample["taught"][0], [turned * columns, rows])
    np.testing.assert_array_equal(sample["taught"][1], [-turned * columns, -rows])


def test_half_of_the_pairs_are_mirrored() -> None:
    own = replace(OWN, flip=True)
    made = samples(Counting(), own=own)
    seen = [made(numbered_pair(), np.random.default_rng(seed))["taught"] for seed in range(8)]
    assert {bool((taught[0, 0] <= 0).all()) for taught in seen} == {True, False}


def test_around_the_piece_is_what_the_image_has_there() -> None:
    sample = samples(Counting())(numbered_pair(), np.random.default_rng(1))
    left, top = sample["taught"][0, :, 0, 0] - 8
    for image in sample["images"]:
        places = np.indices(image.shape[1:]) + np.array([top, left])[:, None, None]
        limits = np.array([90, 140])[:, None, None]
        inside = ((places >= 0) & (places < limits)).all(axis=0)
        np.testing.assert_array_equal(image[3] > 0, inside)
        np.testing.assert_allclose(255 * image[:2, inside], places[:, inside], atol=1e-4)
        assert not image[:3, ~inside].any()


def test_a_teacher_is_asked_once_about_a_whole_pair_while_that_is_kept() -> None:
    teacher = Counting()
    made = samples(teacher, kept=2.5)
    drawn = [
        made({**numbered_pair(), "key": key}, np.random.default_rng(number))
        for number, key in enumerate("abacabc")
    ]
    # There was no room left for c.
    assert teacher.asked == 4
    assert teacher.seen is not None
    assert teacher.seen[0].shape == (90, 140, 3)
    forgetful = Counting()
    anew = samples(forgetful, kept=0)
    for number, (key, sample) in enumerate(zip("abacabc", drawn, strict=True)):
        again = anew({**numbered_pair(), "key": key}, np.random.default_rng(number))
        for name in ("input", "images", "taught", "trusted", "hidden"):
            np.testing.assert_array_equal(again[name], sample[name])
    assert forgetful.asked == 7


def test_a_piece_too_small_is_refused() -> None:
    with pytest.raises(SettingsError, match="64 px a side"):
        PairSettings(height_px=32)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ({"kept_mb": -1}, "pairs.kept_mb"),
        ({"kept_mb": math.nan}, "pairs.kept_mb"),
        ({"scale": math.nan}, "a scale between 0 and 16"),
        ({"boxes": 0}, "pairs.boxes"),
        ({"teacher_iterations": 0}, "pairs.teacher_iterations"),
        ({"least_box": 0.5}, "pairs.least_box"),
        ({"largest_box": -1}, "pairs.largest_box"),
    ],
)
def test_settings_that_nothing_can_be_cut_with_are_refused(
    setting: dict[str, float], said: str
) -> None:
    with pytest.raises(SettingsError, match=re.escape(said)):
        PairSettings(**setting)


def test_how_much_is_kept_changes_no_model() -> None:
    teacher = {"model_id": "a", "settings": {"network": {"size": "small"}}}

    def made(assignments: dict[str, str]) -> str:
        return plan_finetuning(teacher, None, assignments).identity("snapshot").model_id

    assert made({"pairs.kept_mb": "5"}) == made({}) != made({"pairs.boxes": "5"})
