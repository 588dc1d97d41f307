from __future__ import annotations

import numpy as np
import pytest
from street import SENSOR_HEIGHT_M, FakeTables, Street, measure, street_frames

from tcrdata.evidence import ground
from tcrdata.evidence.point_rows import read_encoded
from tcrdata.types import PointCloud


@pytest.fixture(scope="module")
def street() -> Street:
    return Street(frames_count=3)


def test_the_road_is_ground_and_heights_are_above_it(street: Street) -> None:
    tables = FakeTables()
    measure(ground, street, tables)
    frame = street_frames(street)[1]
    xyz = street.read_points(frame).xyz
    flags = read_encoded(tables, 1, "ground")
    heights = read_encoded(tables, 1, "height_m")
    assert flags is not None
    assert heights is not None
    true_heights = SENSOR_HEIGHT_M - xyz[:, 1]
    near = np.hypot(xyz[:, 0], xyz[:, 2]) < 40
    assert flags.decode()[near & (true_heights < 0.02)].mean() > 0.98
    assert flags.decode()[true_heights > 0.3].mean() < 0.01
    assert np.quantile(np.abs(heights.decode() - true_heights)[near], 0.95) < 0.15
    assert flags.summary == pytest.approx(flags.decode().mean())


def test_neither_chunks_nor_order_matter(street: Street) -> None:
    one, other = FakeTables(), FakeTables()
    measure(ground, street, one, chunk_frames=1)
    measure(ground, street, other, chunk_frames=3, frames=street_frames(street)[::-1])
    for n in range(3):
        assert read_encoded(one, n, "ground") == read_encoded(other, n, "ground")
        assert read_encoded(one, n, "height_m") == read_encoded(other, n, "height_m")


def test_a_damaged_frame_is_reported_and_a_sparse_one_has_no_ground() -> None:
    tables = FakeTables()
    measure(ground, Street(frames_count=3, broken=(1,), sparse=(2,)), tables)
    assert [row["frame"] for row in tables.rows["errors"]] == [1]
    assert "damaged" in tables.rows["errors"][0]["error"]
    flags, heights = (read_encoded(tables, 2, cue) for cue in ("ground", "height_m"))
    assert flags is not None
    assert heights is not None
    assert not flags.decode().any()
    assert np.isnan(heights.decode()).all()
    assert heights.summary is None


def test_nothing_is_printed(street: Street, capfd: pytest.CaptureFixture[str]) -> None:
    measure(ground, street, FakeTables())
    assert capfd.readouterr().out == ""


def test_a_tilted_table_is_found_under_objects() -> None:
    random = np.random.default_rng(0)
    xz = random.uniform(-2, 2, (4000, 2))
    y = 0.1 * xz[:, 0] - 0.05 * xz[:, 1] + 1.0 + 0.005 * random.standard_normal(4000)
    y[:1000] -= random.uniform(0.1, 0.5, 1000)
    xyz = np.column_stack([xz[:, 0], y, xz[:, 1]]).astype(np.float32)
    settings = ground.Settings(plane_margin_m=0.03)
    frame = street_frames(Street(frames_count=1))[0]
    cloud = PointCloud(xyz, np.zeros(4000, np.float32))
    flags, heights = ground.measure(cloud, frame, "depth", settings)
    assert flags[1000:].mean() > 0.99
    assert not flags[:1000].any()
    assert np.allclose(ground.ground_plane(xyz, settings), [0.1, -0.05, 1.0], atol=0.005)
    assert heights[:1000].min() > 0.08
