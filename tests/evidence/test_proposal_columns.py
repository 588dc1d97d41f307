"""Columns of proposals: 2D boxes in front of the camera, across its plane and behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_world import two_frames

from tcrdata.evidence.proposal_columns import box_columns, outline_columns, vote_columns
from tcrdata.geometry.boxes import edge_distance
from tcrdata.types import Camera, Frame

PIXELS = ("left_px", "top_px", "right_px", "bottom_px")


@pytest.fixture(scope="module")
def frame() -> Frame:
    _, _, frames = two_frames(np.eye(4))
    projection = ((100.0, 0.0, 100.0, 0.0), (0.0, 100.0, 50.0, 0.0), (0.0, 0.0, 1.0, 0.0))
    level = tuple(tuple(row) for row in np.eye(4).tolist())
    return replace(frames[0], camera=Camera(projection, 200, 100), camera_T_level=level)


def box(z: float, x: float = 0.0) -> list[float]:
    return [x, 0.0, z, 2.0, 1.0, 1.0, 0.0]


def test_boxes_are_projected_one_like_many(frame: Frame) -> None:
    boxes = np.array([box(10.0), box(0.6), box(-5.0), box(10.0, 40.0)])
    columns = box_columns(boxes, frame)
    assert [columns[name][0] for name in PIXELS] == pytest.approx(
        [100 - 100 / 9.5, 50 - 50 / 9.5, 100 + 100 / 9.5, 50 + 50 / 9.5]
    )
    assert columns["truncated_share"][0] == pytest.approx(0.0, abs=1e-9)
    # Cut at the plane near the camera, so that it fills the image.
    assert [columns[name][1] for name in PIXELS] == [0.0, 0.0, 200.0, 100.0]
    assert [columns[name][2] for name in (*PIXELS, "center_u_px", "truncated_share")] == [None] * 6
    assert [columns[name][3] for name in PIXELS] == [None] * 4
    assert columns["truncated_share"][3] == 1.0
    for i in range(4):
        alone = box_columns(boxes[i : i + 1], frame)
        assert {name: values[i] for name, values in columns.items()} == {
            name: values[0] for name, values in alone.items()
        }


def test_no_boxes_and_no_camera(frame: Frame) -> None:
    assert set(map(tuple, box_columns(np.empty((0, 7)), frame).values())) == {()}
    assert box_columns(np.array([box(5.0)]), replace(frame, camera=None))["left_px"] == [None]


def test_outlines_and_votes_are_those_of_each_box(frame: Frame) -> None:
    random = np.random.default_rng(0)
    boxes = np.array([box(10.0), box(12.0), box(14.0)])
    clouds = [random.normal(size=(n, 2)).astype(np.float32) for n in (7, 0, 20)]
    columns = outline_columns(boxes, clouds, 0.3)
    gaps = [edge_distance(xz, one) for xz, one in zip(clouds, boxes, strict=True)]
    assert columns["fit_residual_m"] == [gaps[0].mean(), None, gaps[2].mean()]
    assert columns["edge_share"] == [(gaps[0] <= 0.3).mean(), None, (gaps[2] <= 0.3).mean()]
    free, static = np.array([0, 3, 2, 5], np.uint8), np.array([1, 1, 2, 0], np.uint8)
    none = np.empty(0, np.int64)
    assert vote_columns([np.array([1, 2, 3]), none, np.array([0])], free, static) == {
        "core_points": [2, 0, 0],
        "core_share": [2 / 3, None, 0.0],
        "votes_free_mean": [10 / 3, None, 0.0],
        "votes_static_mean": [1.0, None, 1.0],
        "free_share": [2 / 3, None, 0.0],
    }
