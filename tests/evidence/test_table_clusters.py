"""Depth averaged over time, regions above a table, boxes completed where something hides a part."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tcrdata.datasets.cater import Cater, open_dataset
from tcrdata.errors import FrameError
from tcrdata.evidence import table_clusters
from tcrdata.evidence.depth_frames import AveragingSettings, averaged, depth_noise
from tcrdata.evidence.table_regions import Region
from tcrdata.evidence.table_tracks import TrackSettings, follow
from tcrdata.geometry.boxes import bev_iou
from tcrdata.types import CueInput, Frame, PointCloud

SPEC = "clips=1,seed=4,frames=5,cameras=2"
BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
random = np.random.default_rng(0)


def noisy(depth_m: float, frames: int = 7) -> np.ndarray:
    return (depth_m + 0.05 * random.standard_normal((frames, 40, 40))).astype(np.float32)


def test_noise_is_measured_and_averaged_away() -> None:
    window = noisy(10.0)
    assert depth_noise(list(window)) == pytest.approx(0.05, rel=0.1)
    assert depth_noise(list(window[:1])) == 0.0
    mean = averaged(window, 3, 0.05, AveragingSettings())
    assert abs(float(mean.mean()) - 10.0) < 0.01
    assert float(mean.std()) < 0.02


def test_what_moved_is_not_blurred_and_gaps_are_filled_between_like_depths() -> None:
    window = noisy(10.0)
    window[4:, :, 20:] -= 2.0
    window[3, 5, 5] = window[3, 5, 30] = 0.0
    mean = averaged(window, 3, 0.05, AveragingSettings())
    assert abs(float(mean[:, 20:].mean()) - 10.0) < 0.02
    assert mean[5, 5] == pytest.approx(10.0, abs=0.1)
    assert mean[5, 30] == 0.0


def region(frame: int, left: float, right: float, hidden: float = 0.0, **values: Any) -> Region:
    """What a camera at the origin sees of a cube of 1 m at z 9.5 to 10.5 m, from left to right."""
    plain = Region(
        frame=frame,
        pixels=200,
        points=np.arange(200, dtype=np.int32),
        rectangle=((left + right) / 2, 10.0, max(right - left, 1.0), min(right - left, 1.0), 0.0),
        fill_share=1.0,
        sight=-np.pi / 2,
        front_m=9.5,
        sides_m=(left, right),
        hidden_sides=(0.0, 4 * hidden, 0.0),
        hidden_share=hidden,
        image_hidden_share=hidden,
        heights_m=(0.05, 1.0),
        plane_y_m=5.0,
        box_px=(100.0, 100.0, 130.0, 130.0),
    )
    return replace(plain, **values)


def test_a_box_behind_another_is_completed_from_before_and_after() -> None:
    seen = [region(n, 0.1 * n - 0.5, 0.1 * n + 0.5) for n in range(9)]
    seen[4] = region(4, -0.1, 0.3, hidden=0.2)
    tracked = follow(seen, range(9), TrackSettings(), 0.35)
    assert {entry.track for entry in tracked} == {0}
    assert [entry.clear for entry in tracked] == [n != 4 for n in range(9)]
    for boxes in (tracked[4].box, tracked[4].disc):
        np.testing.assert_allclose(boxes[[0, 2, 3, 4]], [0.4, 10.0, 1.0, 1.0], atol=0.05)
    assert tracked[4].box[5] == pytest.approx(1.0)


def test_a_box_that_stays_hidden_is_held_by_the_side_that_is_seen() -> None:
    seen = [region(n, -0.5, 0.5) for n in range(4)]
    seen += [region(n, -0.5, 0.1, hidden=0.2) for n in range(4, 7)]
    last = follow(seen, range(7), TrackSettings(), 0.35)[-1]
    np.testing.assert_allclose(last.box[[0, 2, 3, 4]], [0.0, 10.0, 1.0, 1.0], atol=0.05)
    np.testing.assert_allclose(last.disc[[0, 2, 3]], [0.0, 10.0, 1.0], atol=0.05)


def test_no_regions_give_no_tracks() -> None:
    assert follow([], range(3), TrackSettings(), 0.35) == []


def rows_of(settings: table_clusters.Settings, sensor: str = "depth") -> list[dict[str, Any]]:
    cater = open_dataset(SPEC)
    sequence = cater.sequences()[0]
    cue = CueInput(
        info=replace(cater.info(sequence), sensor=sensor),  # type: ignore[arg-type]
        frames=tuple(cater.frames(sequence)),
        dataset=cater,
        tables=None,  # type: ignore[arg-type]
        settings=settings,
        parallel=map,  # type: ignore[arg-type]
    )
    batches = [rows.columns for rows in table_clusters.run(cue) if rows.table == "proposals"]
    return [
        dict(zip(columns, values, strict=True))
        for columns in batches
        for values in zip(*columns.values(), strict=True)
    ]


@pytest.mark.parametrize("fused", [False, True])
def test_visible_things_are_found_by_one_camera_or_two(fused: bool) -> None:
    rows = rows_of(table_clusters.Settings(fuse_cameras=fused, chunk_frames=5))
    truths = [row for row in open_dataset(SPEC).ground_truth("clip_0000_camera_0")
              if row["visible_px"] >= 50]  # fmt: skip
    found = 0
    for truth in truths:
        own = np.array([[truth[name] for name in BOX]])
        boxes = [r for r in rows if r["frame"] == truth["frame"]]
        overlap = bev_iou(own, np.array([[r[name] for name in BOX] for r in boxes]))[0]
        found += overlap.max(initial=0.0) > 0.5
    assert found >= 0.9 * len(truths)
    assert {row["source"] for row in rows} == {"table"}
    assert all(row["yaw_observable"] == (row["fit"] == "min_area") for row in rows)
    assert len({row["proposal_id"] for row in rows}) == len(rows)


def test_a_camera_alone_trusts_no_more_than_it_sees(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = rows_of(table_clusters.Settings(fuse_cameras=False, chunk_frames=5))
    read = Cater.read_points

    def of_the_first(self: Cater, frame: Frame) -> PointCloud:
        if frame.sequence.endswith("_1"):
            raise FrameError("gone")
        return read(self, frame)

    monkeypatch.setattr(Cater, "read_points", of_the_first)
    assert rows_of(table_clusters.Settings(fuse_cameras=True, chunk_frames=5)) == alone


def test_frames_that_cannot_be_read_end_no_track() -> None:
    shown = [0, 1, 2, 30]
    seen = [region(n, -0.5, 0.5) for n in shown]
    assert {entry.track for entry in follow(seen, shown, TrackSettings(), 0.35)} == {0}
    assert {entry.track for entry in follow(seen, range(31), TrackSettings(), 0.35)} == {0, 1}


def test_chunks_change_nothing_but_the_measured_noise() -> None:
    whole = rows_of(table_clusters.Settings(fuse_cameras=False, chunk_frames=5))
    parts = rows_of(table_clusters.Settings(fuse_cameras=False, chunk_frames=2))
    assert [row["proposal_id"] for row in whole] == [row["proposal_id"] for row in parts]


def test_lidar_sweeps_give_no_rows() -> None:
    assert rows_of(table_clusters.Settings(), sensor="lidar") == []
