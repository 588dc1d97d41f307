from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from plane_world import (
    BOX,
    EVERYTHING_CONSISTENT,
    HEIGHT,
    WIDTH,
    MemoryTables,
    cue_input,
    egomotion_rows,
    flow_rows,
    motion,
    two_frames,
    without_image,
)

from tcrdata.evidence import motion as cue_motion
from tcrdata.evidence import regions_paper
from tcrdata.evidence.moving_regions import confidence_of
from tcrdata.evidence.stored_flow import read_flow

EGO = motion(0.05, 0.0, -0.2, yaw=0.005)


def world(box_moves: tuple[float, float, float] = (0.5, 0, 0)) -> tuple[Any, MemoryTables, Any]:
    dataset, tables, frames = two_frames(EGO, box_moves)
    tables.add(egomotion_rows(EGO))
    tables.add(cue_motion.run(cue_input(dataset, tables, cue_motion.Settings(), frames)))
    return dataset, tables, frames


def run(built: tuple[Any, MemoryTables, Any], scale: float = 1.0) -> MemoryTables:
    dataset, tables, frames = built
    result = MemoryTables()
    cue = cue_input(dataset, tables, regions_paper.Settings(), frames, scale)
    result.add(regions_paper.run(cue))
    return result


@pytest.fixture(scope="module")
def found() -> MemoryTables:
    return run(world())


def largest(tables: MemoryTables, level_m: float, fit: str = "min_area") -> dict[str, Any]:
    rows = tables.rows["proposals"]
    chosen = [r for r in rows if r["motion_threshold_m"] == level_m and r["fit"] == fit]
    return max(chosen, key=lambda row: row["number_of_points"])


def test_a_moving_box_is_a_region_with_its_place_size_and_motion(found: MemoryTables) -> None:
    row = largest(found, 0.2)
    # Columns 60 to 99, rows 40 to 79 at 6 m.
    assert row["x_m"] == pytest.approx(-0.03, abs=0.05)
    assert row["y_m"] == pytest.approx(-0.03, abs=0.05)
    assert row["z_m"] == pytest.approx(6.0, abs=0.05)
    assert (row["length_m"], row["height_m"]) == pytest.approx((39 * 0.06, 39 * 0.06), abs=0.1)
    assert row["width_m"] == pytest.approx(0, abs=0.05)
    assert row["motion_3d_m"] == pytest.approx(0.5, abs=0.02)
    assert row["motion_2d_px"] == pytest.approx(50 / 5.8, rel=0.03)
    assert row["center_surround_chi2"] > 0.9
    assert row["range_m"] == pytest.approx(6.0, abs=0.05)
    assert row["edge_share"] == 1.0


def test_every_level_is_cut_and_none_above_the_motion(found: MemoryTables) -> None:
    sizes = {level: largest(found, level)["number_of_points"] for level in (0.1, 0.2, 0.4)}
    assert all(1300 < size <= 1700 for size in sizes.values())
    in_box = np.zeros((HEIGHT, WIDTH), dtype=bool)
    in_box[BOX] = True
    beyond = [r for r in found.rows["proposals"] if r["motion_threshold_m"] == 0.8]
    assert not any(in_box.ravel()[row["point_indices"]].any() for row in beyond)
    levels = {
        (row["motion_threshold_m"], row["motion_threshold_next_m"])
        for row in found.rows["proposals"]
    }
    assert levels <= {(0.1, 0.2), (0.2, 0.4), (0.4, 0.8), (0.8, None)}
    assert (0.4, 0.8) in levels


def test_two_fits_share_a_region(found: MemoryTables) -> None:
    first, second = largest(found, 0.2), largest(found, 0.2, "l_shape")
    assert first["region_id"] == second["region_id"]
    assert first["proposal_id"] == f"{first['region_id']}/min_area"
    assert first["point_indices"] == second["point_indices"]
    assert len({row["proposal_id"] for row in found.rows["proposals"]}) == len(
        found.rows["proposals"]
    )


def test_each_proposal_has_a_confidence_of_both_modules(found: MemoryTables) -> None:
    row = largest(found, 0.2)
    by_module = {
        c["module"]: c for c in found.rows["confidences"] if c["proposal_id"] == row["proposal_id"]
    }
    assert set(by_module) == {"motion_3d", "motion_2d"}
    assert by_module["motion_3d"]["raw_value"] == row["motion_3d_m"]
    assert by_module["motion_3d"]["confidence"] == pytest.approx(
        1 - math.exp(-math.log(2) * row["motion_3d_m"] / 0.25)
    )
    assert by_module["motion_2d"]["unit"] == "px"


def test_confidence_is_one_half_at_its_half_way_point() -> None:
    assert confidence_of(0.0, 0.25) == 0
    assert confidence_of(0.25, 0.25) == pytest.approx(0.5)
    assert confidence_of(100.0, 0.25) == pytest.approx(1)


def test_a_uniform_field_does_not_stand_out() -> None:
    dataset, tables, frames = two_frames(motion(z=0.5) @ EGO)
    tables.add(egomotion_rows(EGO))  # half a metre wrong: everything moves alike
    tables.add(cue_motion.run(cue_input(dataset, tables, cue_motion.Settings(), frames)))
    rows = run((dataset, tables, frames)).rows["proposals"]
    inside = [r for r in rows if r["motion_threshold_m"] == 0.4 and r["number_of_points"] > 500]
    assert inside
    for row in inside:
        assert row["center_surround_chi2"] is None or row["center_surround_chi2"] < 0.5


def test_a_static_world_has_no_large_region() -> None:
    rows = run(world((0, 0, 0))).rows.get("proposals", [])
    assert all(row["number_of_points"] < 200 for row in rows if row["motion_threshold_m"] >= 0.2)


def test_levels_follow_the_metric_scale_and_keep_their_name() -> None:
    small = run(world((0.1, 0, 0)), scale=0.2)
    row = largest(small, 0.4)  # 0.4 x 0.2 = 0.08 m
    assert row["number_of_points"] > 1300
    assert row["metric_scale"] == 0.2


def test_inconsistent_flow_takes_no_part() -> None:
    dataset, tables, frames = world()
    stored = read_flow(tables, *frames)
    assert stored is not None
    tables.rows["flows"] = []
    tables.add(flow_rows(0, 1, stored.decode(), planes=EVERYTHING_CONSISTENT - 1))
    assert not run((dataset, tables, frames)).rows


def test_the_same_input_gives_the_same_rows(found: MemoryTables) -> None:
    assert run(world()).rows == found.rows


def test_without_images_or_motion_there_are_no_rows() -> None:
    dataset, tables, frames = world()
    assert not run((dataset, tables, (frames[0], without_image(1)))).rows
    tables.rows["point_evidence"] = []
    assert not run((dataset, tables, frames)).rows


def test_other_points_than_were_measured_are_an_error() -> None:
    dataset, tables, frames = world()
    cloud = dataset.clouds[0]
    dataset.clouds[0] = type(cloud)(cloud.xyz[:-1], cloud.reflectance[:-1])
    (error,) = run((dataset, tables, frames)).rows["errors"]
    assert error["frame"] == 0


def test_heights_come_from_the_ground_cue_when_it_ran() -> None:
    from tcrdata.evidence.point_rows import encoded, point_rows

    dataset, tables, frames = world()
    heights = 2.0 - dataset.clouds[0].xyz[:, 1]
    tables.add([point_rows([encoded(0, "height_m", "f32", heights)])])
    row = largest(run((dataset, tables, frames)), 0.2)
    box = dataset.clouds[0].xyz[np.array(row["point_indices"])]
    assert row["bottom_above_ground_m"] == pytest.approx(2.0 - box[:, 1].max(), abs=1e-5)
    assert row["top_above_ground_m"] == pytest.approx(2.0 - box[:, 1].min(), abs=1e-5)
