"""Greedy matching and overlaps on cases worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcrdata.evaluation.ap import average_precision
from tcrdata.evaluation.matching import match
from tcrdata.evaluation.overlap import bev_overlap, covered_share, image_overlap

UNKNOWN = np.full((1, 3, 3), np.nan)
YES = np.array([True])
NO_SIZE = np.full((1, 3), np.nan)


def car(x: float, z: float, yaw: float = 0.0) -> np.ndarray:
    return np.array([[x, 1.0, z, 4.0, 2.0, 1.5, yaw]])


def test_surest_label_takes_first_and_falls_back_to_what_is_free() -> None:
    overlap = np.array([[0.8, 0.0], [0.9, 0.6], [0.4, 0.0]])
    found = match(overlap, np.array([True, True]), np.array([0.3, 0.7]))
    assert found.tolist() == [[0, 1, -1], [0, -1, -1]]


def test_unscored_objects_take_what_remains_many_times() -> None:
    overlap = np.array([[0.6, 0.9], [0.6, 0.9], [0.0, 0.9]])
    found = match(overlap, np.array([True, False]), np.array([0.5]))
    assert found.tolist() == [[0, 1, 1]]


def test_nothing_to_match() -> None:
    assert match(np.zeros((2, 0)), np.zeros(0, bool), np.array([0.5])).tolist() == [[-1, -1]]
    assert match(np.zeros((0, 2)), np.ones(2, bool), np.array([0.5])).shape == (1, 0)


def test_shifted_and_turned_footprints() -> None:
    shifted = bev_overlap(car(1.0, 10.0), car(0.0, 10.0), UNKNOWN, NO_SIZE, YES)
    assert shifted[0, 0] == pytest.approx(3 / 5)
    turned = bev_overlap(car(0.0, 10.0, math.pi / 2), car(0.0, 10.0), UNKNOWN, NO_SIZE, YES)
    assert turned[0, 0] == pytest.approx(4 / 12)


def test_round_objects_have_no_yaw() -> None:
    ball = np.array([[0.0, 0.0, 5.0, 1.0, 1.0, 1.0, 0.0]])
    label = np.array([[0.1 * math.cos(0.7), 0.0, 5.0 - 0.1 * math.sin(0.7), 1.0, 1.0, 1.0, 0.7]])
    iou = bev_overlap(label, ball, UNKNOWN, NO_SIZE, np.array([False]))
    assert iou[0, 0] == pytest.approx(0.9 / 1.1)


def test_tilted_objects_have_the_shadow_of_their_corners() -> None:
    c = s = math.sqrt(0.5)
    # A cube of 2 m on its edge: columns length, height and width, turned about the width axis.
    rotation = np.array([[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]])
    cube = np.array([[0.0, 0.0, 5.0, 2.0, 2.0, 2.0, 0.0]])
    label = np.array([[0.0, 0.0, 5.0, 2 * math.sqrt(2), 2.0, 2.0, 0.0]])
    assert bev_overlap(label, cube, rotation, NO_SIZE, YES)[0, 0] == pytest.approx(1.0)
    assert bev_overlap(cube, cube, rotation, NO_SIZE, YES)[0, 0] == pytest.approx(math.sqrt(0.5))


def test_boxes_in_the_image() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [np.nan] * 4])
    other = np.array([[5.0, 0.0, 15.0, 10.0]])
    assert image_overlap(boxes, other)[:, 0] == pytest.approx([1 / 3, 0.0])
    assert covered_share(boxes, other) == pytest.approx([0.5, 0.0])
    assert covered_share(boxes, np.empty((0, 4))).tolist() == [0.0, 0.0]


def test_average_precision_by_hand() -> None:
    scores = np.array([0.9, 0.8, 0.7, 0.6])
    hits = np.array([True, False, True, False])
    assert average_precision(scores, hits, 4) == pytest.approx(0.25 * 1 + 0.25 * 2 / 3)
    assert average_precision(scores[:0], hits[:0], 0) is None
    assert average_precision(scores[:0], hits[:0], 3) == 0.0
    assert average_precision(scores, hits, 0) == 0.0


def test_equal_scores_enter_together() -> None:
    scores = np.array([0.5, 0.5])
    for hits in ([True, False], [False, True]):
        assert average_precision(scores, np.array(hits), 1) == 0.5
