from __future__ import annotations

import numpy as np
import pytest

from tcrdata.evaluation.flow import FlowScore, flow_score, total_score


def test_a_score_by_hand() -> None:
    truth = np.zeros((1, 5, 2), np.float32)
    truth[0, 2] = (100, 0)
    truth[0, 4] = np.nan
    flow = truth + np.float32([(0, 0), (3, 4), (0, 4), (0, 2), (9, 9)])
    consistent = np.array([[True, False, True, False, True]])
    score = flow_score(np.nan_to_num(flow), consistent, truth)
    assert score.known == 4
    assert score.epe_px == pytest.approx((0 + 5 + 4 + 2) / 4)
    # 4 px of 100 are less than 5 %: no outlier.
    assert score.outlier_share == pytest.approx(1 / 4)
    assert score.consistent_share == pytest.approx(3 / 5)
    assert score.epe_consistent_px == pytest.approx(2)
    assert score.epe_inconsistent_px == pytest.approx(3.5)
    assert score.epe_moving_px == pytest.approx(4)
    zeros = score.of_zeros()
    assert zeros == flow_score(np.zeros_like(flow), np.ones((1, 5), bool), truth)
    assert (zeros.epe_px, zeros.epe_moving_px, zeros.outlier_share) == (25, 100, 0.25)


def test_without_truth_only_the_consistent_share_is_known() -> None:
    score = flow_score(np.zeros((2, 2, 2), np.float32), np.eye(2, dtype=bool), None)
    assert score.consistent_share == 0.5
    assert (score.epe_px, score.outlier_share) == (None, None)
    assert (score.epe_consistent_px, score.epe_inconsistent_px) == (None, None)


def test_scores_add_up_pixel_by_pixel() -> None:
    parts = [FlowScore(10, 5, 4, 2, 1, 8.0, 1.0), FlowScore(30, 30, 12, 12, 3, 4.0, 4.0)]
    total = total_score(parts)
    assert total.epe_px == pytest.approx(12 / 16)
    assert total.consistent_share == pytest.approx(35 / 40)
    assert total.epe_inconsistent_px == pytest.approx(7 / 2)
    assert total_score([]).epe_px is None
