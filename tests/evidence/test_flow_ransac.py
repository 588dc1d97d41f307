from __future__ import annotations

import numpy as np
import pytest
from plane_world import (
    ArrayDataset,
    MemoryTables,
    cue_input,
    flow_rows,
    frame,
    motion,
    two_frames,
    without_image,
)

from tcrdata.evidence import flow_ransac
from tcrdata.evidence.flow_ransac import Estimate, egomotion_row
from tcrdata.evidence.rigid_ransac import RigidFit
from tcrdata.evidence.stored_flow import Pair

TRUE = motion(0.1, 0.02, -0.3, yaw=0.01)


def measured(
    to_T_from: np.ndarray,
    scale: float = 1.0,
    box_moves: tuple[float, float, float] = (0, 0, 0),
    **settings: object,
) -> dict[str, object]:
    dataset, tables, frames = two_frames(to_T_from, box_moves)
    cue = cue_input(dataset, tables, flow_ransac.Settings(**settings), frames, scale)
    (rows,) = flow_ransac.run(cue)
    assert rows.table == "egomotions"
    return {name: values[0] for name, values in rows.columns.items()}


def test_both_directions_find_the_motion() -> None:
    row = measured(TRUE)
    np.testing.assert_allclose(np.reshape(row["to_T_from"], (4, 4)), TRUE, atol=2e-3)
    np.testing.assert_allclose(np.reshape(row["from_T_to"], (4, 4)), np.linalg.inv(TRUE), atol=2e-3)
    assert (row["frame"], row["frame_to"], row["method"]) == (0, 1, "flow_ransac")
    assert row["inlier_share"] > 0.9
    assert row["residual_m"] < 0.05
    assert row["translation_m"] == pytest.approx(np.linalg.norm(TRUE[:3, 3]), abs=2e-3)
    assert row["rotation_rad"] == pytest.approx(0.01, abs=1e-3)
    assert 0 < row["cycle_error_m"] < 0.01
    assert (row["alignment_share"], row["alignment_frames"]) == (1.0, 1)


def test_the_cycle_error_of_a_wrong_backward_estimate_is_how_far_it_misses() -> None:
    agree = np.ones(5, dtype=bool)
    wrong = motion(x=0.3) @ np.linalg.inv(TRUE)
    xyz = np.random.default_rng(0).uniform(-20, 20, (100, 3)).astype(np.float32)
    row = egomotion_row(
        Pair(frame(0), frame(1)),
        xyz,
        Estimate(10, RigidFit(TRUE, agree, 0.01)),
        Estimate(10, RigidFit(wrong, agree, 0.01)),
    )
    assert row["cycle_error_m"] == pytest.approx(0.3, abs=1e-5)
    assert row["inlier_share"] == 0.5


def test_a_turned_backward_estimate_errs_most_far_away() -> None:
    agree = np.ones(5, dtype=bool)
    turned = motion(yaw=0.01) @ np.linalg.inv(TRUE)
    xyz = np.array([(0, 0, 1), (0, 0, 50)], np.float32)
    row = egomotion_row(
        Pair(frame(0), frame(1)),
        xyz,
        Estimate(10, RigidFit(TRUE, agree, 0.01)),
        Estimate(10, RigidFit(turned, agree, 0.01)),
    )
    assert row["cycle_error_m"] == pytest.approx(2 * 50 * np.sin(0.005), rel=1e-3)


def test_flows_that_fail_the_cycle_test_take_no_part() -> None:
    dataset, tables, frames = two_frames(TRUE)
    wild = np.random.default_rng(0).uniform(-30, 30, (120, 160, 2)).astype(np.float32)
    tables.rows["flows"] = []
    tables.add(flow_rows(0, 1, wild, planes=1))  # the paper's test alone
    tables.add(flow_rows(1, 0, wild, planes=1))
    (rows,) = flow_ransac.run(cue_input(dataset, tables, flow_ransac.Settings(), frames))
    assert rows.columns["to_T_from"] == [None]
    assert rows.columns["cycle_error_m"] == [None]
    assert rows.columns["inliers"] == [0]
    assert rows.columns["alignment_share"] == [None]
    looser = flow_ransac.Settings(cycle_test="paper")
    (rows,) = flow_ransac.run(cue_input(dataset, tables, looser, frames))
    assert rows.columns["inlier_share"][0] is not None


def test_the_inlier_radius_follows_the_metric_scale() -> None:
    wide = measured(TRUE, box_moves=(0.1, 0, 0))
    narrow = measured(TRUE, scale=0.1, box_moves=(0.1, 0, 0))
    # The box is 1600 of the pixels: within 0.25 m, not within 0.025 m.
    assert wide["inliers"] - narrow["inliers"] == pytest.approx(1600, abs=100)
    np.testing.assert_allclose(np.reshape(narrow["to_T_from"], (4, 4)), TRUE, atol=1e-5)


def test_the_same_input_gives_the_same_rows_however_it_is_cut() -> None:
    assert measured(TRUE) == measured(TRUE, pairs_per_task=1)


def test_without_images_or_flow_there_are_no_rows() -> None:
    dataset, tables, frames = two_frames(TRUE)
    blind = [frames[0], without_image(1)]
    assert not list(flow_ransac.run(cue_input(dataset, tables, flow_ransac.Settings(), blind)))
    empty = MemoryTables()
    assert not list(flow_ransac.run(cue_input(dataset, empty, flow_ransac.Settings(), frames)))


def test_a_sweep_that_cannot_be_read_is_one_error() -> None:
    _, tables, frames = two_frames(TRUE)
    cue = cue_input(ArrayDataset({}), tables, flow_ransac.Settings(), frames)
    (rows,) = flow_ransac.run(cue)
    assert rows.table == "errors"
    assert rows.columns["frame"] == [0]
