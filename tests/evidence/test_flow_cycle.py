from __future__ import annotations

import numpy as np
import pytest

from tcrdata.evidence import flow_cycle


def constant(u: float, v: float = 0.0, height: int = 20, width: int = 40) -> np.ndarray:
    return np.broadcast_to(np.array([u, v], np.float32), (height, width, 2)).copy()


def test_a_flow_that_returns_passes_and_a_patch_that_does_not_fails() -> None:
    back = constant(-2.0)
    back[5:10, 20:30] = (3.0, 0.0)
    cycle = flow_cycle.measure(constant(2.0), back)
    wrong = np.zeros((20, 40), dtype=bool)
    wrong[5:10, 18:28] = True  # these pixels end in the patch
    inside = np.ones((20, 40), dtype=bool)
    inside[:, 38:] = False  # these leave the image
    for passed in (cycle.paper, cycle.release):
        np.testing.assert_array_equal(passed, inside & ~wrong)
    np.testing.assert_array_equal(np.isnan(cycle.error_px), ~inside)
    assert cycle.error_px[7, 20] == pytest.approx(5.0)
    assert cycle.error_px[0, 0] == 0.0


def test_the_paper_compares_squares_and_the_release_lengths() -> None:
    cycle = flow_cycle.measure(constant(20.0), constant(-18.0))
    # 4 < 0.05 (400 + 324) + 0.5, but 2 > 0.05 sqrt(724) + 0.5.
    assert cycle.paper[3, 3]
    assert not cycle.release[3, 3]
    close = flow_cycle.measure(constant(20.0), constant(-18.5))
    assert close.release[3, 3]  # 1.5 < 0.05 sqrt(742.25) + 0.5


def test_the_flow_back_is_sampled_between_pixels() -> None:
    back = np.zeros((20, 40, 2), np.float32)
    back[..., 0] = np.arange(40)[None, :] * 0.1
    back[..., 1] = np.arange(20)[:, None] * 0.2
    cycle = flow_cycle.measure(constant(2.5, 1.25), back)
    # At (10, 4) the flow ends at (12.5, 5.25): w'' = (1.25, 1.05).
    assert cycle.error_px[4, 10] == pytest.approx(np.hypot(3.75, 2.3), abs=1e-5)


def test_reached_marks_the_corners_of_every_end() -> None:
    mask = flow_cycle.reached(constant(2.0))
    assert not mask[:, :2].any()
    assert mask[:, 2:].all()


def test_a_pixel_that_no_flow_back_reaches_is_not_one_to_one() -> None:
    still = constant(0.0)
    back = still.copy()
    back[:, 10:15] = (9.0, 0.0)  # nothing returns to columns 11 to 13
    sure = flow_cycle.Cycle(
        np.zeros((20, 40), np.float32), np.ones((20, 40), bool), np.ones((20, 40), bool)
    )
    here, there = flow_cycle.one_to_one(still, back, sure, sure)
    assert not here[:, 11:14].any()
    assert here[:, 16:].all()
    assert here[:, :10].all()
    # In the other frame they end at columns 19 to 23, which hold, but 1 to 1 is asked of both.
    assert there[:, 10:15].all()


def test_both_ends_must_hold() -> None:
    still = constant(0.0)
    holds, fails = np.ones((20, 40), bool), np.ones((20, 40), bool)
    fails[4, 4] = False
    error = np.zeros((20, 40), np.float32)
    here, there = flow_cycle.one_to_one(
        still, still, flow_cycle.Cycle(error, holds, holds), flow_cycle.Cycle(error, holds, fails)
    )
    assert not here[4, 4]
    assert not there[4, 4]
    assert here.sum() == there.sum() == 20 * 40 - 1
