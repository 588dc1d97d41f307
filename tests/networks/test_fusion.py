"""Looks at a scene that was turned agree on boxes of the scene as it stands."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.geometry.boxes import points_in_box
from tcrdata.networks.decoding import Detections
from tcrdata.networks.fusion import fused, turned_boxes, turned_points
from tcrdata.networks.grids import Region

REGION = Region(8.0, 0.0, 16.0, 0.5)
TURNS = (0.0, 0.2, -0.2)
CAR = np.array([2.3, np.nan, 9.1, 4.2, 1.8, 1.5, 0.5])


def seen(*pairs: tuple[np.ndarray, float]) -> Detections:
    boxes = np.array([box for box, _ in pairs]).reshape(-1, 7)
    return Detections(boxes, np.array([score for _, score in pairs]))


def test_points_and_boxes_turn_together() -> None:
    rng = np.random.default_rng(0)
    box = np.where(np.isnan(CAR), 0.9, CAR)
    xyz = (box[:3] + rng.uniform(-3, 3, (400, 3))).astype(np.float32)
    (turned,) = turned_boxes(box[None], 0.7)
    assert np.array_equal(points_in_box(turned_points(xyz, 0.7), turned), points_in_box(xyz, box))
    assert turned_boxes(turned[None], -0.7)[0] == pytest.approx(box)


def test_what_all_looks_see_stays_and_what_one_sees_counts_for_less() -> None:
    ghost = CAR + np.array([-5.0, 0, 0, 0, 0, 0, 0])
    looks = [seen((CAR, 0.9), (ghost, 0.6)), seen((CAR, 0.7)), seen((CAR, 0.5))]
    both = fused(looks, TURNS, REGION, 0.3)
    assert both.scores == pytest.approx([0.7, 0.2])
    assert both.boxes == pytest.approx(np.array([CAR, ghost]), nan_ok=True)


def test_a_box_is_the_mean_by_score_and_its_heading_the_surest() -> None:
    other = CAR + np.array([0.3, 0, 0, 0, 0, 0, 0.1 + np.pi])
    both = fused([seen((CAR, 0.6)), seen((other, 0.3)), seen((CAR, 0.6))], TURNS, REGION, 0.3)
    assert both.boxes[0, [0, 6]] == pytest.approx([CAR[0] + 0.06, CAR[6] + 0.02])


def test_a_look_that_cannot_see_a_place_has_no_say() -> None:
    """At the left edge, one turn carries the place out of the ground that is covered."""
    edge = np.array([-7.6, np.nan, 9.0, 2.0, 1.6, 1.5, 0.0])
    both = fused([seen((edge, 0.8)), seen((edge, 0.6)), seen()], TURNS, REGION, 0.3)
    assert both.scores == pytest.approx([0.7])


def test_nothing_is_seen_outside_nor_where_nothing_is() -> None:
    outside = CAR + np.array([10.0, 0, 0, 0, 0, 0, 0])
    assert not len(fused([seen(), seen((outside, 0.9)), seen()], TURNS, REGION, 0.3).scores)
    assert fused([seen()] * 3, TURNS, REGION, 0.3).boxes.shape == (0, 7)
