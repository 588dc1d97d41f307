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
    picture,
    sweep,
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


def sweep_file(folder: Path, frame: int) -> Path:
    return folder / "velodyne_points" / "data" / f"{frame:010d}.bin"


def image_file(folder: Path, frame: int) -> Path:
    return folder / "image_02" / "data" / f"{frame:010d}.png"


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


def test_a_number_that_no_file_has_is_a_gap(raw: Raw) -> None:
    dataset, folder = raw
    sweep_file(folder, 2).unlink()
    image_file(folder, 2).unlink()
    assert [(f.frame, f.status) for f in dataset.frames(DRIVE)] == [
        (number, "ok") for number in (0, 1, 3, 4)
    ]


def test_an_image_without_a_sweep_is_a_frame_in_error(raw: Raw) -> None:
    dataset, folder = raw
    sweep_file(folder, 2).unlink()
    frame = dataset.frames(DRIVE)[2]
    assert (frame.frame, frame.status, frame.error) == (2, "error", "no sweep")
    with pytest.raises(FrameError, match=r"frame 2 .* no sweep"):
        dataset.read_points(frame)


def test_a_sweep_without_an_image_is_a_frame_without_one(raw: Raw) -> None:
    dataset, folder = raw
    image_file(folder, 2).unlink()
    frame = dataset.frames(DRIVE)[2]
    assert (frame.status, frame.has_image, frame.image_error) == ("ok", False, "no image")
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


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data[:-5], "cut short: .* bytes"),
        (lambda data: b"", "has no points"),
    ],
)
def test_a_sweep_of_an_impossible_size_is_seen_without_reading(
    raw: Raw, damage: Callable[[bytes], bytes], message: str
) -> None:
    dataset, folder = raw
    good = dataset.frames(DRIVE)[1]
    path = sweep_file(folder, 1)
    path.write_bytes(damage(path.read_bytes()))
    frames = dataset.frames(DRIVE)
    assert [f.status for f in frames] == ["ok", "error", "ok", "ok", "ok"]
    assert frames[1].error is not None
    assert path.name in frames[1].error
    with pytest.raises(FrameError, match=message):
        dataset.read_points(good)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("column", ["x", "y", "z", "reflectance"])
def test_a_sweep_with_numbers_that_are_none_names_frame_column_and_count(
    raw: Raw, value: float, column: str
) -> None:
    dataset, folder = raw
    points = sweep(3)
    points[5:7, ["x", "y", "z", "reflectance"].index(column)] = value
    points.tofile(sweep_file(folder, 3))
    frame = dataset.frames(DRIVE)[3]
    with pytest.raises(FrameError, match=rf"frame 3: .*2 of {len(points)} points .* {column} "):
        dataset.read_points(frame)


def test_a_sweep_of_nan_alone_is_a_frame_error(raw: Raw) -> None:
    dataset, folder = raw
    np.full((10, 4), np.nan, dtype=np.float32).tofile(sweep_file(folder, 0))
    with pytest.raises(FrameError, match="10 of 10 points"):
        dataset.read_points(dataset.frames(DRIVE)[0])


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def no_png(path: Path) -> None:
    path.write_bytes(b"\xff\xd8\xff" + b"0" * 200)


def enlarge(path: Path) -> None:
    picture(0).resize((WIDTH_PX + 2, HEIGHT_PX)).save(path)


@pytest.mark.parametrize(
    ("damage", "message"),
    [(truncate, "cut short"), (no_png, "not a PNG"), (enlarge, "162x48")],
)
@pytest.mark.parametrize("frame", [0, 3])
def test_a_bad_image_leaves_the_points(
    raw: Raw, damage: Callable[[Path], None], message: str, frame: int
) -> None:
    dataset, folder = raw
    damage(image_file(folder, frame))
    frames = dataset.frames(DRIVE)
    assert {f.status for f in frames} == {"ok"}
    assert [f.frame for f in frames if not f.has_image] == [frame]
    bad = frames[frame]
    assert bad.image_error is not None
    assert message in bad.image_error
    assert image_file(folder, frame).name in bad.image_error
    assert len(dataset.read_points(bad)) > 0
    with pytest.raises(FrameError, match=message):
        dataset.read_image(bad)


def test_damage_inside_an_image_is_seen_when_it_is_read(raw: Raw) -> None:
    dataset, folder = raw
    path = image_file(folder, 1)
    data = bytearray(path.read_bytes())
    data[60:90] = bytes(30)
    path.write_bytes(data)
    with pytest.raises(FrameError, match=r"0000000001\.png cannot be decoded"):
        dataset.read_image(dataset.frames(DRIVE)[1])


def rewrite_line(path: Path, line: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("sensor", ["velodyne_points", "image_02"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2011-09-26 13:02:25.000000000", "does not rise"),
        ("2011-09-26 13:0", "is not a time"),
        ("", "is not a time"),
    ],
)
def test_a_wrong_time_names_file_and_line(raw: Raw, sensor: str, text: str, message: str) -> None:
    dataset, folder = raw
    rewrite_line(folder / sensor / "timestamps.txt", 3, text)
    frames = dataset.frames(DRIVE)
    assert [f.status for f in frames] == ["ok", "ok", "error", "ok", "ok"]
    assert frames[2].error is not None
    assert f"{sensor}/timestamps.txt, line 3" in frames[2].error
    assert message in frames[2].error
    assert (np.diff([f.timestamp_ns for f in frames]) > 0).all()


def test_a_drive_without_any_clock_says_which_files_are_missing(raw: Raw) -> None:
    dataset, folder = raw
    (folder / "velodyne_points" / "timestamps.txt").unlink()
    assert {f.status for f in dataset.frames(DRIVE)} == {"ok"}
    (folder / "image_02" / "timestamps.txt").unlink()
    with pytest.raises(DatasetError, match=r"no timestamps: .*velodyne_points/timestamps\.txt"):
        dataset.frames(DRIVE)


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
            expected = 8.0 if row["object_id"] == "0" else 0.0
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
