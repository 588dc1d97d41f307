from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from street import FakeTables, Street, measure, street_frames

from tcrdata.errors import FrameError
from tcrdata.evidence import ground, odometry
from tcrdata.evidence.depth_path import DepthPath
from tcrdata.evidence.lidar_path import motion_power
from tcrdata.evidence.poses import read_poses
from tcrdata.types import Frame, PointCloud


@pytest.fixture(scope="module")
def driven() -> FakeTables:
    tables = FakeTables()
    street = Street(frames_count=14)
    measure(ground, street, tables)
    measure(odometry, street, tables)
    return tables


def test_both_directions_find_the_drive(driven: FakeTables) -> None:
    rows = driven.rows["egomotions"]
    assert [(r["frame"], r["frame_to"]) for r in rows] == [(n, n + 1) for n in range(13)]
    for row in rows[3:-3]:
        onward = np.reshape(row["to_T_from"], (4, 4))
        back = np.reshape(row["from_T_to"], (4, 4))
        assert onward[:3, 3] == pytest.approx([0, 0, -0.5], abs=0.05)
        assert back[:3, 3] == pytest.approx([0, 0, 0.5], abs=0.05)
        assert row["translation_m"] == pytest.approx(0.5, abs=0.05)
        assert row["rotation_rad"] < 0.005
        assert 0 <= row["cycle_error_m"] < 0.5
        assert not np.array_equal(back, np.linalg.inv(onward))


def test_alignment_is_measured_ten_frames_later_or_at_the_end(driven: FakeTables) -> None:
    rows = driven.rows["egomotions"]
    assert [r["alignment_frames"] for r in rows] == [10, 10, 10, 10, *range(9, 0, -1)]
    assert all(r["alignment_share"] > 0.3 for r in rows)


def test_poses_chain_the_links(driven: FakeTables) -> None:
    poses = read_poses(driven)
    assert poses.world_T_level[13][:3, 3] == pytest.approx([0, 0, 6.5], abs=0.2)
    assert poses.linked(0, 13)


def test_the_same_rows_twice_and_in_other_chunks(driven: FakeTables) -> None:
    street, again = Street(frames_count=14), FakeTables()
    measure(ground, street, again)
    measure(odometry, street, again, chunk_frames=3)
    assert again.rows["egomotions"] == driven.rows["egomotions"]


def test_damaged_and_sparse_frames_are_passed_over() -> None:
    street, tables = Street(frames_count=7, broken=(2,), sparse=(4,)), FakeTables()
    measure(ground, street, tables)
    measure(odometry, street, tables)
    links = [(r["frame"], r["frame_to"]) for r in tables.rows["egomotions"]]
    assert links == [(0, 1), (1, 3), (3, 5), (5, 6)]
    assert [r["frame"] for r in tables.rows["errors"]] == [2, 2]


@dataclass(frozen=True)
class _Decaying(Street):
    """A street whose sweep `lost` can be read a few times only."""

    lost: int = -1
    left: list[int] = field(default_factory=list, compare=False)

    def read_points(self, frame: Frame) -> PointCloud:
        if frame.frame == self.lost and not self.left:
            raise FrameError(f"frame {frame.frame}: the disk is gone")
        if frame.frame == self.lost:
            self.left.pop()
        return super().read_points(frame)


def test_a_sweep_that_is_lost_before_the_checks_fails_its_frame_alone() -> None:
    street, tables = _Decaying(frames_count=14, lost=11, left=[1, 1, 1]), FakeTables()
    measure(ground, street, tables)
    measure(odometry, street, tables, chunk_frames=5)
    assert [(r["frame"], r["error"]) for r in tables.rows["errors"]] == [
        (11, "frame 11: the disk is gone")
    ]
    rows = {r["frame"]: r for r in tables.rows["egomotions"]}
    assert list(rows) == list(range(13))
    assert [n for n, r in rows.items() if r["cycle_error_m"] is None] == [11]
    assert [n for n, r in rows.items() if r["alignment_share"] is None] == [1, 11]
    assert read_poses(tables).linked(0, 13)


def test_a_sweep_that_is_lost_on_the_way_back_is_reported() -> None:
    street, tables = _Decaying(frames_count=6, lost=3, left=[1, 1]), FakeTables()
    measure(ground, street, tables)
    measure(odometry, street, tables)
    assert [r["frame"] for r in tables.rows["errors"]] == [3]
    assert [(r["frame"], r["frame_to"]) for r in tables.rows["egomotions"]] == [
        (0, 1), (1, 2), (4, 5)
    ]  # fmt: skip


def test_frames_far_apart_in_time_are_not_linked() -> None:
    street, tables = Street(), FakeTables()
    frames = (*street_frames(street, range(2)), *street_frames(street, range(20, 22)))
    measure(ground, street, tables, frames=frames)
    measure(odometry, street, tables, frames=frames)
    assert [(r["frame"], r["frame_to"]) for r in tables.rows["egomotions"]] == [(0, 1), (20, 21)]
    assert not read_poses(tables).linked(1, 20)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_frames_make_no_rows(count: int) -> None:
    street, tables = Street(frames_count=count), FakeTables()
    measure(odometry, street, tables, frames=street_frames(street))
    assert "egomotions" not in tables.rows


BLOCKS = ((-1.5, 0.5, 0.5), (1.0, 1.5, 0.6), (0.5, -1.5, 0.4), (2.0, -0.5, 0.5))


def _table(shift: float, moved: float, seed: int) -> np.ndarray:
    """A flat table with fixed blocks and one that moves, seen with noise; (N, 3) points."""
    random = np.random.default_rng(seed)
    xz = random.uniform(-3, 3, (8000, 2))
    points = [np.column_stack([xz[:, 0], np.full(len(xz), 1.0), xz[:, 1]])]
    for x, z, size in (*BLOCKS, (-1.0 + moved, -1.0, 0.4)):
        faces = random.uniform(-0.5, 0.5, (900, 3))
        faces[np.arange(900), np.arange(900) % 3] = np.where(np.arange(900) % 2, 0.5, -0.5)
        points.append(faces * size + [x, 1.0 - size / 2, z])
    xyz = np.concatenate(points) - [shift, 0.0, 0.0]
    return (xyz + 0.005 * random.standard_normal(xyz.shape)).astype(np.float32)


def _depth_path() -> DepthPath:
    return DepthPath(voxel_m=0.1, gate_m=0.2, support_share=0.02, overlap_share=0.7)


def test_a_standing_depth_camera_stands_while_something_moves() -> None:
    path = _depth_path()
    for n in range(6):
        pose = path.add(_table(0.0, 0.1 * n, n), 1.0)
        assert np.linalg.norm(pose[:3, 3]) < 0.005


def test_a_moving_depth_camera_is_measured() -> None:
    path = _depth_path()
    poses = [path.add(_table(0.08 * n, 0.0, n), 1.0) for n in range(6)]
    assert poses[-1][:3, 3] == pytest.approx([0.4, 0, 0], abs=0.04)


def test_a_motion_can_be_stretched() -> None:
    motion = np.eye(4)
    motion[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    motion[:3, 3] = [1.0, 2.0, 3.0]
    half = motion_power(motion, 0.5)
    assert half[:3, :3] @ half[:3, :3] == pytest.approx(motion[:3, :3])
    assert half[:3, 3] == pytest.approx([0.5, 1.0, 1.5])
