from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from plane_world import (
    BOX,
    HEIGHT,
    WIDTH,
    ArrayDataset,
    MemoryTables,
    cue_input,
    egomotion_rows,
    frame,
    motion,
    two_frames,
    without_image,
)

from tcrdata.evidence import motion as cue_motion
from tcrdata.store.arrays import decode_points
from tcrdata.types import Frame

EGO = motion(0.05, 0.0, -0.2, yaw=0.005)


def run(
    dataset: ArrayDataset,
    tables: MemoryTables,
    frames: Sequence[Frame],
    settings: cue_motion.Settings | None = None,
) -> dict[str, np.ndarray]:
    cue = cue_input(dataset, tables, settings or cue_motion.Settings(), frames)
    found = {}
    for rows in cue_motion.run(cue):
        columns = rows.columns
        for i, name in enumerate(columns["cue"]):
            count = columns["number_of_points"][i]
            assert columns["frame"][i] == 0
            values = decode_points(columns["codec"][i], columns["data"][i], count)
            found[name] = values.reshape(HEIGHT, WIDTH)
    return found


def world(box_moves: tuple[float, float, float]) -> tuple:
    dataset, tables, frames = two_frames(EGO, box_moves)
    tables.add(egomotion_rows(EGO))
    return dataset, tables, frames


def test_a_static_world_does_not_move() -> None:
    found = run(*world((0, 0, 0)))
    # Where a nearer surface covers the end of a flow, the pair is of two surfaces.
    measured = found["motion_3d_m"][np.isfinite(found["motion_3d_m"])]
    assert len(measured) > 0.8 * HEIGHT * WIDTH
    # Of points that share a pixel the nearest is the partner: at most a pixel away, or on the box.
    assert np.median(measured) < 1e-3
    assert (measured < 0.15).mean() > 0.9
    assert np.nanmax(found["motion_2d_px"]) < 0.02
    moving = np.isfinite(found["motion_cosine"])
    assert np.median(found["motion_cosine"][moving]) == pytest.approx(1.0, abs=1e-3)


def test_a_moving_box_moves_as_far_as_it_does() -> None:
    found = run(*world((0.5, 0.0, 0.0)))
    box = found["motion_3d_m"][BOX]
    assert np.nanmedian(box) == pytest.approx(0.5, abs=0.02)
    # 0.5 m at 6 m - 0.2 m, focal length 100 px.
    assert np.nanmedian(found["motion_2d_px"][BOX]) == pytest.approx(50 / 5.8, rel=0.02)
    outside = np.ones((HEIGHT, WIDTH), dtype=bool)
    outside[BOX] = False
    assert np.nanmedian(found["motion_3d_m"][outside]) < 1e-2
    assert np.nanmedian(found["motion_cosine"][BOX]) < np.nanmedian(found["motion_cosine"][outside])


def test_a_point_whose_flow_leaves_the_image_has_no_3d_motion() -> None:
    dataset, tables, frames = two_frames(motion(x=4.0))
    tables.add(egomotion_rows(motion(x=4.0)))
    found = run(dataset, tables, frames)
    assert np.isnan(found["motion_3d_m"][60, 150])
    assert found["motion_2d_px"][60, 150] == pytest.approx(0, abs=0.02)


def test_a_flow_of_no_length_has_cosine_zero() -> None:
    dataset, tables, frames = two_frames(np.eye(4), (0.5, 0, 0))
    tables.add(egomotion_rows(np.eye(4)))
    found = run(dataset, tables, frames)
    assert (found["motion_cosine"][np.isfinite(found["motion_cosine"])] == 0).all()


def test_a_wrong_egomotion_is_taken_as_it_is() -> None:
    dataset, tables, frames = two_frames(EGO)
    tables.add(egomotion_rows(motion(z=1.0) @ EGO))
    assert np.nanmedian(run(dataset, tables, frames)["motion_3d_m"]) == pytest.approx(1, abs=0.01)


def test_the_other_estimator_can_be_chosen() -> None:
    dataset, tables, frames = two_frames(EGO)
    tables.add(egomotion_rows(motion(z=1.0) @ EGO, "flow_ransac"))
    tables.add(egomotion_rows(EGO, "odometry"))
    found = run(dataset, tables, frames, cue_motion.Settings(egomotion="odometry"))
    assert np.nanmedian(found["motion_3d_m"]) < 0.01


def test_without_image_flow_or_egomotion_there_are_no_rows() -> None:
    dataset, tables, frames = world((0, 0, 0))
    assert not run(dataset, tables, (frame(0), without_image(1)))
    tables.rows["egomotions"][0]["to_T_from"] = None
    assert not run(dataset, tables, frames)
    tables.rows["flows"] = []
    assert not run(dataset, tables, frames)


def test_the_same_input_gives_the_same_bytes() -> None:
    first, second = run(*world((0.5, 0, 0))), run(*world((0.5, 0, 0)))
    for name in ("motion_3d_m", "motion_2d_px", "motion_cosine"):
        assert first[name].tobytes() == second[name].tobytes()
