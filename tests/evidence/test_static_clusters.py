"""What stands still: a parked car's shell is found, a hedge has few points on its edges."""

from __future__ import annotations

import numpy as np
import pytest
from box_world import GROUND_Y, BoxWorld, Thing, collected

from tcrdata.evidence import static_clusters
from tcrdata.geometry.boxes import bev_iou

PARKED = Thing(3.5, 16.0, yaw=-1.5)
BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")


def rows_of(world, **settings):
    cue = world.cue(static_clusters.Settings(**settings))
    return collected(static_clusters.run(cue), "proposals")


def hedge():
    rng = np.random.default_rng(0)
    low, high = [-7, GROUND_Y - 1.5, 12], [-4, GROUND_Y - 0.3, 16]
    return rng.uniform(low, high, (3000, 3)).astype(np.float32)


def test_a_parked_car_is_one_object_in_every_frame():
    world = BoxWorld((PARKED,), frames_count=24, own_speed=5.0)
    rows = rows_of(world)
    assert [row["frame"] for row in rows] == list(range(24))
    assert {row["track_id"] for row in rows} == {"boxes/one/static/0000"}
    for row in rows:
        box = np.array([[row[name] for name in BOX]])
        assert bev_iou(box, PARKED.box(row["frame"], 5.0)[None])[0, 0] > 0.8
        assert row["edge_share"] > 0.9
        assert row["number_of_points"] > 50
        assert row["track_core_share"] == 0.0
        assert row["height_m"] == pytest.approx(1.5, abs=0.1)


def test_a_hedge_has_few_points_on_its_edges():
    rows = rows_of(BoxWorld((PARKED,), own_speed=5.0, clutter=hedge()))
    shares = {row["track_id"]: row["edge_share"] for row in rows}
    assert len(shares) >= 2
    assert min(shares.values()) < 0.45


def test_what_moves_is_not_on_the_map():
    assert rows_of(BoxWorld((Thing(-8.0, 14.0, speed=8.0),))) == []


def test_windows_share_the_ids_of_their_objects():
    world = BoxWorld((PARKED, Thing(-4.0, 20.0, yaw=-1.6)), frames_count=30, own_speed=3.0)
    rows = rows_of(world, window_frames=8, margin_frames=6)
    assert len({row["track_id"] for row in rows}) == 2
    assert len({row["proposal_id"] for row in rows}) == len(rows) == 60


def test_the_same_input_gives_the_same_rows():
    world = BoxWorld((PARKED,), own_speed=5.0, clutter=hedge())
    assert rows_of(world) == rows_of(world)


def test_without_points_there_is_no_row():
    assert rows_of(BoxWorld(())) == []
