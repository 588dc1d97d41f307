from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kitti_tree import (
    DRIVE,
    HEIGHT_PX,
    LEVEL_T_SENSOR,
    P2,
    SEQUENCE,
    WIDTH_PX,
    box_in_level,
    image_file,
    picture,
    sweep,
    sweep_file,
    write_raw,
    write_tracking,
)

from tcrdata.datasets.kitti import KittiDataset, open_dataset
from tcrdata.errors import DatasetError, FrameError
from tcrdata.types import Frame

Raw = tuple[KittiDataset, Path]


@pytest.fixture
def raw(tmp_path: Path) -> Raw:
    folder = write_raw(tmp_path)
    return open_dataset(str(tmp_path)), folder


@pytest.mark.parametrize("below", ["", "2011_09_26", f"2011_09_26/{DRIVE}"])
def test_raw_opens_at_the_root_the_date_and_the_drive(tmp_path: Path, below: str) -> None:
    write_raw(tmp_path)
    dataset = open_dataset(str(tmp_path / below))
    assert dataset.sequences() == [DRIVE]
    frame = dataset.frames(DRIVE)[2]
    assert frame.points_path is not None
    assert (tmp_path / below / frame.points_path) == sweep_file(tmp_path / "2011_09_26" / DRIVE, 2)
    assert len(dataset.read_points(frame)) == len(sweep(2))


@pytest.mark.parametrize("below", ["", "training"])
def test_tracking_opens_at_the_root_and_at_training(tmp_path: Path, below: str) -> None:
    write_tracking(tmp_path)
    dataset = open_dataset(str(tmp_path / below))
    assert dataset.sequences() == [SEQUENCE]
    assert len(dataset.read_points(dataset.frames(SEQUENCE)[0])) == len(sweep(0))


@pytest.mark.parametrize("below", ["", "2011_09_26", f"2011_09_26/{DRIVE}"])
def test_the_fingerprint_does_not_depend_on_where_the_root_is(tmp_path: Path, below: str) -> None:
    write_raw(tmp_path / "a")
    write_raw(tmp_path / "b")
    fingerprints = [
        open_dataset(str(root)).info(DRIVE).fingerprint
        for root in (tmp_path / "a", tmp_path / "b" / below)
    ]
    assert fingerprints[0] == fingerprints[1]


def test_the_fingerprint_follows_calibration_times_and_sizes(raw: Raw) -> None:
    dataset, folder = raw
    seen = {dataset.info(DRIVE).fingerprint}
    for path in (
        folder.parent / "calib_cam_to_cam.txt",
        folder / "velodyne_points" / "timestamps.txt",
        sweep_file(folder, 1),
        image_file(folder, 1),
    ):
        path.write_bytes(path.read_bytes() + b"\n" * 16)
        seen.add(dataset.info(DRIVE).fingerprint)
    assert len(seen) == 5


def test_both_layouts_give_the_same_geometry(tmp_path: Path) -> None:
    write_raw(tmp_path / "raw")
    write_tracking(tmp_path / "tracking")
    for root, sequence in (("raw", DRIVE), ("tracking", SEQUENCE)):
        dataset = open_dataset(str(tmp_path / root))
        frame = dataset.frames(sequence)[3]
        np.testing.assert_allclose(frame.sensor_matrix, LEVEL_T_SENSOR, atol=1e-9)
        np.testing.assert_array_equal(frame.camera_T_level, np.eye(4))
        assert frame.camera is not None
        np.testing.assert_allclose(frame.camera.matrix, P2)
        assert (frame.camera.width_px, frame.camera.height_px) == (WIDTH_PX, HEIGHT_PX)
        cloud, points = dataset.read_points(frame), sweep(3)
        expected = np.column_stack([points[:, :3], np.ones(len(points))]) @ LEVEL_T_SENSOR.T
        np.testing.assert_allclose(cloud.xyz, expected[:, :3], atol=1e-4)
        np.testing.assert_array_equal(cloud.reflectance, points[:, 3])
        np.testing.assert_array_equal(dataset.read_image(frame), np.asarray(picture(3)))


def test_a_cut_drive_keeps_its_numbers_and_their_times(tmp_path: Path) -> None:
    write_raw(tmp_path, first_frame=100, frames=3)
    frames = open_dataset(str(tmp_path)).frames(DRIVE)
    assert [frame.frame for frame in frames] == [100, 101, 102]
    # The clock starts at 13:02:25, 10 frames a second.
    assert frames[0].timestamp_ns == 1317042155_000_000_000
    assert frames[2].timestamp_ns - frames[0].timestamp_ns == 200_000_000


def test_tracking_counts_a_tenth_of_a_second_a_frame(tmp_path: Path) -> None:
    write_tracking(tmp_path, frames=3)
    frames = open_dataset(str(tmp_path)).frames(SEQUENCE)
    assert [frame.timestamp_ns for frame in frames] == [0, 100_000_000, 200_000_000]


def test_a_number_that_no_file_has_is_a_frame_in_error(raw: Raw) -> None:
    dataset, folder = raw
    sweep_file(folder, 2).unlink()
    image_file(folder, 2).unlink()
    frames = dataset.frames(DRIVE)
    assert [f.frame for f in frames if f.status == "ok"] == [0, 1, 3, 4]
    assert frames[2].error == "neither sweep nor image; fetch its .bin and .png again"
    assert frames[2].timestamp_ns - frames[1].timestamp_ns == 100_000_000
    assert dataset.info(DRIVE).number_of_frames == 5


def test_a_number_far_from_the_others_is_refused(raw: Raw) -> None:
    dataset, folder = raw
    sweep_file(folder, 4).rename(sweep_file(folder, 400_000))
    with pytest.raises(DatasetError, match=r"frame 4 is followed by frame 400000: .* rename it"):
        dataset.frames(DRIVE)


def test_an_image_without_a_sweep_is_a_frame_in_error(raw: Raw) -> None:
    dataset, folder = raw
    sweep_file(folder, 2).unlink()
    frame = dataset.frames(DRIVE)[2]
    assert (frame.frame, frame.status, frame.error) == (
        2,
        "error",
        "no sweep; fetch its .bin again",
    )
    with pytest.raises(FrameError, match=r"frame 2 .* no sweep"):
        dataset.read_points(frame)


def test_a_sweep_without_an_image_is_a_frame_without_one(raw: Raw) -> None:
    dataset, folder = raw
    image_file(folder, 2).unlink()
    frame = dataset.frames(DRIVE)[2]
    assert (frame.status, frame.has_image, frame.image_error) == (
        "ok",
        False,
        "no image; fetch its .png again",
    )
    with pytest.raises(FrameError, match=r"frame 2 .* no image"):
        dataset.read_image(frame)


@pytest.mark.parametrize("write", [write_raw, write_tracking])
def test_a_drive_without_images_has_points_and_a_projection(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    write(tmp_path, images=False)
    dataset = open_dataset(str(tmp_path))
    (sequence,) = dataset.sequences()
    frames = dataset.frames(sequence)
    assert {(f.status, f.has_image) for f in frames} == {("ok", False)}
    expected = (WIDTH_PX, HEIGHT_PX) if write is write_raw else (1242, 375)
    assert all(f.camera is not None for f in frames)
    assert {(f.camera.width_px, f.camera.height_px) for f in frames if f.camera} == {expected}
    source = "S_rect_02" if write is write_raw else "1242x375"
    assert source in dataset.info(sequence).calibration


def test_other_folders_and_files_are_passed_over(raw: Raw) -> None:
    dataset, folder = raw
    before = dataset.info(DRIVE)
    (folder.parent / "notes").mkdir()
    shutil.copytree(folder, folder.parent / DRIVE.replace("_sync", "_extract"))
    (folder / "image_02" / "data" / "._0000000001.png").write_bytes(b"x")
    (folder / "velodyne_points" / "data" / "copy of 3.bin").write_bytes(b"x")
    assert dataset.sequences() == [DRIVE]
    assert dataset.info(DRIVE) == before


@pytest.mark.parametrize("make", [True, False])
def test_a_root_that_is_not_kitti_says_what_was_looked_for(tmp_path: Path, make: bool) -> None:
    root = tmp_path / "elsewhere"
    if make:
        root.mkdir()
    with pytest.raises(DatasetError, match="elsewhere") as caught:
        open_dataset(str(root))
    if make:
        assert "<date>/<drive>_sync/velodyne_points" in str(caught.value)
        assert "training/velodyne/<sequence>/" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("root", ["", None])
def test_no_root_is_asked_for(root: str | None) -> None:
    with pytest.raises(DatasetError, match="KITTI needs a root"):
        open_dataset(root)


def test_a_drive_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    folder = write_raw(tmp_path)
    shutil.copytree(folder.parent, tmp_path / "copy")
    with pytest.raises(DatasetError, match="keep one"):
        open_dataset(str(tmp_path))


def test_an_empty_drive_says_so(raw: Raw) -> None:
    dataset, folder = raw
    shutil.rmtree(folder / "velodyne_points" / "data")
    shutil.rmtree(folder / "image_02" / "data")
    with pytest.raises(DatasetError, match="has no frames"):
        dataset.frames(DRIVE)


def test_the_truth_is_the_street_s(tmp_path: Path) -> None:
    write_raw(tmp_path / "raw", first_frame=7)
    write_tracking(tmp_path / "tracking", first_frame=7)
    for root, sequence in (("raw", DRIVE), ("tracking", SEQUENCE)):
        rows = open_dataset(str(tmp_path / root)).ground_truth(sequence)
        boxes = [row for row in rows if row["category"] != "DontCare"]
        assert [(r["frame"], r["object_id"]) for r in boxes] == [
            (frame, name) for frame in range(7, 12) for name in ("0", "1")
        ]
        for row in boxes:
            centre, size, yaw = box_in_level(int(row["object_id"]), row["frame"])
            found = [row[name] for name in ("x_m", "y_m", "z_m")]
            np.testing.assert_allclose(found, centre, atol=1e-5)
            found = [row[name] for name in ("length_m", "width_m", "height_m")]
            np.testing.assert_allclose(found, size, atol=1e-5)
            assert row["yaw_rad"] == pytest.approx(yaw, abs=1e-5)
            expected = 14.0 if row["object_id"] == "0" else 0.0
            assert row["speed_mps"] == pytest.approx(expected, abs=1e-3)


def test_image_boxes_of_both_layouts_agree(tmp_path: Path) -> None:
    write_raw(tmp_path / "raw")
    write_tracking(tmp_path / "tracking")
    sides = ("left_px", "top_px", "right_px", "bottom_px")
    of_raw, of_tracking = (
        [[row[side] for side in sides] for row in rows if row["category"] != "DontCare"]
        for rows in (
            open_dataset(str(tmp_path / "raw")).ground_truth(DRIVE),
            open_dataset(str(tmp_path / "tracking")).ground_truth(SEQUENCE),
        )
    )
    np.testing.assert_allclose(of_raw, of_tracking, atol=1e-3)


def test_without_packets_speeds_are_unknown(tmp_path: Path) -> None:
    folder = write_raw(tmp_path)
    shutil.rmtree(folder / "oxts")
    rows = open_dataset(str(tmp_path)).ground_truth(DRIVE)
    assert {row["speed_mps"] for row in rows} == {None}


def test_labels_of_frames_that_are_not_there_are_left_out(raw: Raw) -> None:
    dataset, folder = raw
    for frame in (3, 4):
        sweep_file(folder, frame).unlink()
        image_file(folder, frame).unlink()
    assert {row["frame"] for row in dataset.ground_truth(DRIVE)} == {0, 1, 2}


def test_listing_a_thousand_frames_is_quick(tmp_path: Path) -> None:
    import time

    folder = write_raw(tmp_path, frames=1)
    for number in range(1, 1000):
        sweep_file(folder, number).symlink_to(sweep_file(folder, 0))
        image_file(folder, number).symlink_to(image_file(folder, 0))
    dataset = open_dataset(str(tmp_path))
    seconds = []
    for _ in range(3):
        start = time.process_time()
        frames: list[Frame] = dataset.frames(DRIVE)
        seconds.append(time.process_time() - start)
    assert len(frames) == 1000
    assert min(seconds) < 0.5
