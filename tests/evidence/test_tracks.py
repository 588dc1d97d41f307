"""Tracks of boxes that move: whole, filled, extended, counted, the same on every run."""

from __future__ import annotations

import numpy as np
import pytest
from box_world import BoxWorld, Thing, collected

from tcrdata.evidence import tracks
from tcrdata.geometry.boxes import bev_iou
from tcrdata.store.schemas import columns

CAR = Thing(-8.0, 14.0, speed=8.0, missed=(7, 8))
BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")


def rows_of(world, table="proposals"):
    return collected(tracks.run(world.cue(tracks.Settings())), table)


def overlap(row, thing, own_speed=0.0):
    box = np.array([[row[name] for name in BOX]])
    return bev_iou(box, thing.box(row["frame"], own_speed)[None])[0, 0]


@pytest.mark.parametrize("own_speed", [0.0, 6.0])
def test_a_car_is_one_track_with_whole_boxes_and_filled_gaps(own_speed):
    rows = rows_of(BoxWorld((CAR,), own_speed=own_speed))
    assert [row["frame"] for row in rows] == list(range(20))
    assert {row["track_id"] for row in rows} == {"boxes/one/track/0000"}
    assert [row["frame"] for row in rows if row["found"] == "gap"] == [7, 8]
    assert min(overlap(row, CAR, own_speed) for row in rows) > 0.8
    assert all(row["height_m"] == pytest.approx(1.5, abs=0.1) for row in rows)
    first = rows[0]
    assert (first["age_frames"], first["span_frames"]) == (18, 20)
    assert first["travel_m"] == pytest.approx(15.2, abs=0.5)
    assert first["straightness"] > 0.98
    assert first["at_clip_edge"] is True
    assert first["track_core_share"] == 1.0
    assert [row["speed_mps"] for row in rows] == pytest.approx([8.0] * 20, abs=0.8)


def test_rows_fit_the_schema_and_gaps_have_no_indices():
    rows = rows_of(BoxWorld((CAR,)))
    known = {name for name, _, _ in columns("proposals")}
    assert set(rows[0]) <= known
    for row in rows:
        assert (row["point_indices"] is None) == (row["found"] != "observed")
        assert row["frames_from_observation"] == (0 if row["found"] == "observed" else 1)


def test_an_end_is_extended_while_points_are_in_the_box():
    late = Thing(-8.0, 14.0, speed=8.0)
    world = BoxWorld((late,))
    cue = world.cue(tracks.Settings())
    table = cue.tables
    table._rows["proposals"] = [r for r in table._rows["proposals"] if r["frame"] >= 4]
    rows = collected(tracks.run(cue), "proposals")
    extended = [row for row in rows if row["found"] == "extended"]
    assert [row["frame"] for row in extended] == [0, 1, 2, 3]
    assert min(overlap(row, late) for row in extended) > 0.7
    assert all(row["number_of_points"] >= 12 for row in extended)
    assert [row["frames_from_observation"] for row in extended] == [4, 3, 2, 1]


@pytest.mark.parametrize(("lost", "cut"), [((9, 10, 11), False), ((8, 9, 10, 11, 12), True)])
def test_a_gap_in_the_frames_is_an_edge_of_the_clip(lost, cut):
    """One car comes into view after the gap and leaves before the end; another spans it all."""
    late = Thing(-6.0, 20.0, speed=6.0, missed=(*range(13), 18, 19))
    cue = BoxWorld((CAR, late)).cue(tracks.Settings())
    step = np.eye(4).ravel().tolist()
    links = cue.tables._rows["egomotions"]
    bridge = {**links[0], "frame": lost[0] - 1, "frame_to": lost[-1] + 1, "to_T_from": step}
    kept = [r for r in links if not {r["frame"], r["frame_to"]} & set(lost)]
    cue.tables._rows["egomotions"] = [*kept, bridge]
    rows = collected(tracks.run(cue), "proposals")
    first, second = sorted({row["track_id"] for row in rows})
    by_track = {t: [row for row in rows if row["track_id"] == t] for t in (first, second)}
    assert {row["span_frames"] for row in by_track[first]} == {20}
    assert not set(lost) & {row["frame"] for row in rows}
    assert {row["at_clip_edge"] for row in by_track[second]} == {cut}


def test_rows_far_beyond_an_end_change_no_other_row():
    late = Thing(-8.0, 14.0, speed=8.0)

    def built(**settings):
        cue = BoxWorld((late,)).cue(tracks.Settings(**settings))
        rows = [r for r in cue.tables._rows["proposals"] if r["frame"] >= 9]
        cue.tables._rows["proposals"] = rows
        return {row["frame"]: row for row in collected(tracks.run(cue), "proposals")}

    near, far = built(extend_frames=5), built()
    assert (min(near), min(far)) == (4, 0)
    assert {frame: far[frame] for frame in near} == near
    assert [far[frame]["frames_from_observation"] for frame in range(4)] == [9, 8, 7, 6]
    assert overlap(far[0], late) > 0.5


def test_of_two_tracks_at_one_place_the_surer_one_overlaps():
    rows = rows_of(BoxWorld((CAR, Thing(2.0, 20.0, speed=5.0))))
    assert {row["overlapped_share"] for row in rows} == {0.0}
    shares = tracks_shares([[0, 0, 10, 4, 2, 1, 0], [0.5, 0, 10, 4, 2, 1, 0]], [0.2, 0.9])
    assert shares == pytest.approx([3.5 / 4, 0.0])


def tracks_shares(boxes, ranks):
    from tcrdata.evidence.track_rows import overlapped_shares

    return overlapped_shares(np.array(boxes, dtype=float), np.array(ranks))


def test_confidences_are_shares_and_refer_to_proposals():
    world = BoxWorld((CAR,))
    ids = {row["proposal_id"] for row in rows_of(world)}
    rows = rows_of(world, "confidences")
    assert {row["module"] for row in rows} == {"free_space", "track"}
    assert {row["proposal_id"] for row in rows} == ids
    assert all(0 <= row["confidence"] <= 1 for row in rows)
    assert all(row["confidence"] > 0.9 for row in rows)


def test_the_same_input_gives_the_same_rows():
    world = BoxWorld((CAR, Thing(3.0, 9.0, yaw=1.2, speed=4.0)))
    assert rows_of(world) == rows_of(world)


def test_without_clusters_there_is_no_row():
    assert rows_of(BoxWorld((Thing(3.0, 9.0),))) == []


def test_what_never_changes_its_place_is_no_track():
    cue = BoxWorld((Thing(5.0, 12.0, speed=0.1),)).cue(tracks.Settings())
    assert len(cue.tables._rows["proposals"]) == 20
    assert collected(tracks.run(cue), "proposals") == []
    everything = BoxWorld((Thing(5.0, 12.0, speed=0.1),)).cue(tracks.Settings(least_spread_m=0.0))
    assert len(collected(tracks.run(everything), "proposals")) == 20


def test_how_many_tracks_are_refined_at_once_changes_nothing():
    world = BoxWorld((CAR, Thing(3.0, 9.0, yaw=1.2, speed=4.0)))
    alone = collected(tracks.run(world.cue(tracks.Settings(chunk_tracks=1))), "proposals")
    assert rows_of(world) == alone


def test_without_poses_there_is_no_row():
    cue = BoxWorld((CAR,)).cue(tracks.Settings())
    cue.tables._rows["egomotions"] = []
    assert collected(tracks.run(cue), "proposals") == []
