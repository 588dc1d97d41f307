from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcrdata.datasets.kitti import open_dataset
from tcrdata.geometry.boxes import points_in_box

pytestmark = pytest.mark.real
DRIVE = "2011_09_26_drive_0005_sync"
GEOMETRY = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m")
IMAGE_BOX = ("left_px", "top_px", "right_px", "bottom_px")
# A metre a second tells what moves from what is parked.
MOVING_MPS = 1.0

Truth = dict[tuple[int, str], dict[str, Any]]


@pytest.fixture(scope="module")
def tracking_root(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("tracking")
    training = root / "training"
    drive = real_data / "kitti_raw" / DRIVE[:10] / DRIVE
    for source, name in (("image_02/data", "image_02"), ("velodyne_points/data", "velodyne")):
        folder = training / name / "0000"
        folder.mkdir(parents=True)
        for file in (drive / source).iterdir():
            (folder / f"{int(file.stem):06d}{file.suffix}").symlink_to(file)
    for name in ("calib", "oxts", "label_02"):
        (training / name).symlink_to(real_data / "kitti_tracking" / "training" / name)
    return root


def objects(root: Path, sequence: str) -> Truth:
    rows = open_dataset(str(root)).ground_truth(sequence)
    return {(row["frame"], row["object_id"]): row for row in rows if row["category"] != "DontCare"}


@pytest.fixture(scope="module")
def of_raw(real_data: Path) -> Truth:
    return objects(real_data / "kitti_raw", DRIVE)


@pytest.fixture(scope="module")
def of_tracking(tracking_root: Path) -> Truth:
    return objects(tracking_root, "0000")


def test_raw_frames(real_data: Path) -> None:
    dataset = open_dataset(str(real_data / "kitti_raw"))
    assert dataset.sequences() == [DRIVE]
    frames = dataset.frames(DRIVE)
    assert [frame.frame for frame in frames] == list(range(50))
    assert all(frame.status == "ok" and frame.has_image for frame in frames)
    steps_s = np.diff([frame.timestamp_ns for frame in frames]) * 1e-9
    assert steps_s.min() > 0.10
    assert steps_s.max() < 0.11
    cloud = dataset.read_points(frames[0])
    assert len(cloud) == 123_397
    assert dataset.read_image(frames[0]).shape == (375, 1242, 3)


def test_a_later_cut_starts_at_its_number(real_data: Path) -> None:
    dataset = open_dataset(str(real_data / "kitti_raw_later"))
    first = open_dataset(str(real_data / "kitti_raw")).frames(DRIVE)
    frames = dataset.frames(DRIVE)
    assert [frame.frame for frame in frames] == list(range(100, 125))
    elapsed_s = (frames[0].timestamp_ns - first[0].timestamp_ns) * 1e-9
    assert elapsed_s == pytest.approx(10.33, abs=0.01)
    assert {frame for frame, _ in objects(real_data / "kitti_raw_later", DRIVE)} <= set(
        range(100, 125)
    )


def test_both_layouts_read_the_same_points(real_data: Path, tracking_root: Path) -> None:
    raw, tracking = open_dataset(str(real_data / "kitti_raw")), open_dataset(str(tracking_root))
    for number in (0, 31):
        of_raw, of_tracking = raw.frames(DRIVE)[number], tracking.frames("0000")[number]
        np.testing.assert_allclose(of_raw.sensor_matrix, of_tracking.sensor_matrix, atol=1e-6)
        assert of_raw.camera == of_tracking.camera
        np.testing.assert_allclose(
            raw.read_points(of_raw).xyz, tracking.read_points(of_tracking).xyz, atol=1e-4
        )


def test_tracklets_and_labels_agree(of_raw: Truth, of_tracking: Truth) -> None:
    assert set(of_raw) == set(of_tracking)
    assert len(of_raw) == 151
    for key, row in of_raw.items():
        other = of_tracking[key]
        assert row["category"] == other["category"]
        np.testing.assert_allclose(
            [row[name] for name in GEOMETRY], [other[name] for name in GEOMETRY], atol=1e-3
        )
        turn = (row["yaw_rad"] - other["yaw_rad"] + np.pi) % (2 * np.pi) - np.pi
        assert abs(turn) < 1e-3
    apart = [
        np.abs(np.subtract([row[s] for s in IMAGE_BOX], [of_tracking[key][s] for s in IMAGE_BOX]))
        for key, row in of_raw.items()
    ]
    assert np.median(np.max(apart, axis=1)) < 2.0


def test_regions_left_out_of_scoring_are_kept(tracking_root: Path) -> None:
    rows = open_dataset(str(tracking_root)).ground_truth("0000")
    assert sum(row["category"] == "DontCare" for row in rows) == 77


def test_what_moves_is_known(of_raw: Truth, of_tracking: Truth) -> None:
    for truth in (of_raw, of_tracking):
        speeds = defaultdict(list)
        for (_, name), row in truth.items():
            speeds[name, row["category"]].append(row["speed_mps"])
        moving = {key for key, values in speeds.items() if min(values) > MOVING_MPS}
        parked = {key for key, values in speeds.items() if max(values) < MOVING_MPS}
        assert moving == {("0", "Van"), ("1", "Cyclist"), ("2", "Pedestrian")}
        assert parked == {("3", "Van")}


def test_points_lie_in_the_boxes(real_data: Path, of_raw: Truth) -> None:
    dataset = open_dataset(str(real_data / "kitti_raw"))
    frames = dataset.frames(DRIVE)
    for number in (0, 20, 45):
        points = dataset.read_points(frames[number]).xyz
        for (frame, _), row in of_raw.items():
            if frame == number and row["occluded"] == 0:
                box = np.array([row[name] for name in (*GEOMETRY, "yaw_rad")])
                assert np.count_nonzero(points_in_box(points, box)) > 20
