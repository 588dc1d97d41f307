from __future__ import annotations

import numpy as np
import pytest
from street import SENSOR_HEIGHT_M, FakeTables, Street, measure, street_frames

from tcrdata.errors import EvidenceError
from tcrdata.evidence import free_space, ground, odometry, regions_free_space
from tcrdata.evidence.occlusion import facing_outline
from tcrdata.evidence.point_rows import read_encoded
from tcrdata.geometry.boxes import edge_distance, points_in_box

STREET = Street(frames_count=22)


@pytest.fixture(scope="module")
def judged() -> FakeTables:
    tables = FakeTables()
    for module in (ground, odometry, free_space, regions_free_space):
        measure(module, STREET, tables)
    return tables


def _votes(tables: FakeTables, frame: int) -> np.ndarray:
    rows = [read_encoded(tables, frame, cue) for cue in free_space.VOTES]
    return np.stack([row.decode() for row in rows if row is not None])


def _box(frame: int) -> np.ndarray:
    x, z, length, width = STREET.box(frame)
    return np.array([x, SENSOR_HEIGHT_M - 0.9, z, length, width, 1.8, 0.0])


def test_what_moves_was_not_there_and_walls_were(judged: FakeTables) -> None:
    frame = street_frames(STREET)[11]
    xyz = STREET.read_points(frame).xyz
    flags = read_encoded(judged, 11, "ground")
    assert flags is not None
    objects = ~flags.decode()
    free, static, occluded = _votes(judged, 11).astype(int)
    moving = points_in_box(xyz, _box(11), 0.1) & objects
    candidates = (free >= 1) & (free >= 0.5 * static)
    assert moving.sum() > 100
    assert candidates[moving].mean() > 0.9
    assert candidates[objects & ~moving].mean() < 0.05
    assert static[objects & ~moving].mean() > 5
    assert not (free + static + occluded)[~objects].any()
    assert (free + static + occluded).max() <= 16


def test_the_moving_box_is_a_region(judged: FakeTables) -> None:
    rows = [r for r in judged.rows["proposals"] if r["frame"] == 11 and r["fit"] == "l_shape"]
    best = min(rows, key=lambda r: np.hypot(r["x_m"] - _box(11)[0], r["z_m"] - _box(11)[2]))
    assert np.hypot(best["x_m"] - _box(11)[0], best["z_m"] - _box(11)[2]) < 1.3
    assert best["length_m"] == pytest.approx(4.0, abs=0.6)
    assert best["core_share"] > 0.8
    assert best["number_of_points"] == len(best["point_indices"])
    assert best["top_above_ground_m"] == pytest.approx(1.8, abs=0.2)
    assert best["y_m"] + best["height_m"] / 2 == pytest.approx(SENSOR_HEIGHT_M, abs=0.1)
    assert best["occluded_share"] < 0.5
    assert best["left_px"] is None
    assert best["proposal_id"] == f"{best['region_id']}/l_shape"
    assert best["region_id"].startswith("street/0000/000011/free_space/")


def test_every_proposal_has_one_confidence(judged: FakeTables) -> None:
    ids = [r["proposal_id"] for r in judged.rows["proposals"]]
    assert len(set(ids)) == len(ids)
    assert sorted(r["proposal_id"] for r in judged.rows["confidences"]) == sorted(ids)
    assert all(0 <= r["confidence"] <= 1 for r in judged.rows["confidences"])


def test_chunks_do_not_matter(judged: FakeTables) -> None:
    again = FakeTables()
    again.rows = {k: v for k, v in judged.rows.items() if k != "proposals"}
    again.rows["point_evidence"] = [
        r for r in judged.rows["point_evidence"] if r["cue"] in ("ground", "height_m")
    ]
    measure(free_space, STREET, again, chunk_frames=5)
    measure(regions_free_space, STREET, again, chunk_frames=1)
    for frame in (0, 4, 5, 21):
        assert np.array_equal(_votes(again, frame), _votes(judged, frame))
    key = "proposal_id"
    assert sorted(again.rows["proposals"], key=lambda r: r[key]) == sorted(
        judged.rows["proposals"], key=lambda r: r[key]
    )


def test_damaged_and_lonely_frames() -> None:
    street, tables = Street(frames_count=5, broken=(1,), sparse=(3,)), FakeTables()
    for module in (ground, odometry, free_space, regions_free_space):
        measure(module, street, tables)
    assert {r["frame"] for r in tables.rows["errors"]} == {1}
    assert not _votes(tables, 3).any()
    lonely = FakeTables()
    for module in (ground, odometry, free_space, regions_free_space):
        measure(module, Street(frames_count=1), lonely)
    assert not _votes(lonely, 0).any()
    assert "proposals" not in lonely.rows


def test_no_frames_no_rows() -> None:
    street, tables = Street(frames_count=0), FakeTables()
    with pytest.raises(EvidenceError, match="none of its frames can be used"):
        measure(ground, street, tables, frames=())
    for module in (odometry, free_space, regions_free_space):
        assert not tables.rows
        measure(module, street, tables, frames=())


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.5, -2.0])
@pytest.mark.parametrize("width", [0.0, 2.0])
def test_the_outline_lies_on_the_sides_that_face_the_sensor(yaw: float, width: float) -> None:
    box = np.array([3.0, 1.0, 12.0, 4.0, width, 1.5, yaw])
    points = facing_outline(box, np.zeros(3))
    assert len(points) in (48, 96)
    assert edge_distance(points[:, [0, 2]], box).max() < 1e-9
    assert np.linalg.norm(points[:, [0, 2]], axis=1).mean() <= np.hypot(3.0, 12.0) + 0.1
