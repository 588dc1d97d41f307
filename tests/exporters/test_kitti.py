"""The detection set read back by a parser of its own, and one box worked out by hand."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_worlds import assert_same_boxes, boxes_of, kitti_store, random_labels
from kitti_tree import LEVEL_T_SENSOR, P2, SEQUENCE
from label_worlds import box, frame_row, label_row, make_store, sequence_row

from tcrdata.errors import FrameError, MissingEvidenceError, SettingsError, TcrdataError
from tcrdata.exporters.kitti import export
from tcrdata.exporters.labels import ExportOptions

NAMED = ("left_px", "top_px", "right_px", "bottom_px")
AHEAD = {
    "x_m": 1.0,
    "y_m": 0.75,
    "z_m": 10.0,
    "length_m": 4.0,
    "width_m": 2.0,
    "height_m": 1.5,
    "yaw_rad": -math.pi / 2,  # straight ahead
    **dict(zip(NAMED, (60.0, 20.5, 100.0, 40.0), strict=True)),
    "truncated_share": 0.2,
    "occluded_share": 0.6,
}
ONLY_LABELS = ExportOptions(labels_only=True)


def parse(path: Path) -> list[dict[str, Any]]:
    """Read labels as KITTI's development kit describes them."""
    rows = []
    for line in path.read_text().splitlines():
        kind, *fields = line.split(" ")
        assert len(fields) == 14
        numbers = [float(field) for field in fields]
        rows.append(
            {
                "type": kind,
                "truncated": numbers[0],
                "occluded": int(fields[1]),
                "alpha": numbers[2],
                "box_2d": numbers[3:7],
                "hwl": numbers[7:10],
                "xyz": numbers[10:13],
                "ry": numbers[13],
            }
        )
    return rows


def geometric(row: dict[str, Any]) -> list[float]:
    """Back to x, y, z, length, width, height, yaw of the level frame (camera = level)."""
    height, width, length = row["hwl"]
    x, y, z = row["xyz"]
    return [x, y - height / 2, z, length, width, height, row["ry"]]


def calibration(path: Path) -> dict[str, np.ndarray]:
    lines = [line.split(": ") for line in path.read_text().splitlines()]
    return {name: np.array(values.split(), dtype=float) for name, values in lines}


def test_one_box_by_hand(tmp_path: Path) -> None:
    labels = [label_row(SEQUENCE, 1, "p", 0.9, **AHEAD)]
    card = export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out")
    folder = tmp_path / "out" / "training" / "label_2"
    # alpha = -pi/2 - atan2(1, 10); the bottom is half of 1.5 m below the centre.
    assert (folder / "000001.txt").read_text() == (
        "Car 0.20 2 -1.670465 60.000000 20.500000 100.000000 40.000000 "
        "1.500000 2.000000 4.000000 1.000000 1.500000 10.000000 -1.570796\n"
    )
    assert (folder / "000000.txt").read_text() == ""
    assert (card.labels, card.ignored, card.files) == (1, 0, 3)
    assert "bottom centre" in card.text()


def test_round_trip(tmp_path: Path) -> None:
    labels = random_labels(SEQUENCE, 30, 3)
    export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out", ONLY_LABELS)
    folder = tmp_path / "out" / "training" / "label_2"
    found = [row for n in range(3) for row in parse(folder / f"{n:06d}.txt")]
    assert_same_boxes([geometric(row) for row in found], boxes_of(labels))
    assert all(-math.pi <= row["alpha"] <= math.pi for row in found)
    assert not (tmp_path / "out" / "training" / "image_2" / "000000.png").exists()


def test_undecided_labels_are_regions_that_count_neither_way(tmp_path: Path) -> None:
    unseen = AHEAD | dict.fromkeys(NAMED) | {"z_m": -10.0}
    labels = [
        label_row(SEQUENCE, 0, "p", 0.9, **AHEAD),
        label_row(SEQUENCE, 0, "i", 0.5, state="ignore", **AHEAD),
        label_row(SEQUENCE, 0, "behind", 0.8, **unseen),
        label_row(SEQUENCE, 0, "behind, too", 0.4, state="ignore", **unseen),
    ]
    store = kitti_store(tmp_path / "kitti", labels)
    card = export(store, "s1", tmp_path / "keep", ONLY_LABELS)
    _, ignored = (tmp_path / "keep/training/label_2/000000.txt").read_text().splitlines()
    assert ignored == (
        "DontCare -1 -1 -10 60.000000 20.500000 100.000000 40.000000 -1 -1 -1 -1000 -1000 -1000 -10"
    )
    assert (card.labels, card.ignored) == (1, 1)
    assert "1 labels and 1 ignore regions that no image shows" in card.text()
    card = export(store, "s1", tmp_path / "drop", ExportOptions(ignore="drop", labels_only=True))
    assert [row["type"] for row in parse(tmp_path / "drop/training/label_2/000000.txt")] == ["Car"]
    assert card.ignored == 0


def test_frames_find_their_calibration_image_and_sweep(tmp_path: Path) -> None:
    labels = [label_row(SEQUENCE, 1, "p", 0.9, **AHEAD)]
    export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out")
    training = tmp_path / "out" / "training"
    for number in range(3):
        image = training / "image_2" / f"{number:06d}.png"
        sweep = training / "velodyne" / f"{number:06d}.bin"
        assert image.resolve() == tmp_path / f"kitti/training/image_02/0000/{number:06d}.png"
        assert sweep.resolve() == tmp_path / f"kitti/training/velodyne/0000/{number:06d}.bin"
    numbers = calibration(training / "calib" / "000002.txt")
    assert list(numbers) == [
        "P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo",
    ]  # fmt: skip
    np.testing.assert_allclose(numbers["P2"].reshape(3, 4), P2, atol=1e-9)
    transform = numbers["R0_rect"].reshape(3, 3) @ numbers["Tr_velo_to_cam"].reshape(3, 4)
    np.testing.assert_allclose(transform, LEVEL_T_SENSOR[:3], atol=1e-6)
    with (tmp_path / "out" / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["sequence"], row["frame"]) for row in rows] == [
        (f"{number:06d}", SEQUENCE, str(number)) for number in range(3)
    ]
    assert (tmp_path / "out" / "ImageSets" / "train.txt").read_text() == "000001\n"


def test_a_sweep_that_is_gone_is_named(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", [label_row(SEQUENCE, 1, "p", 0.9, **AHEAD)])
    (tmp_path / "kitti/training/velodyne/0000/000001.bin").unlink()
    with pytest.raises(FrameError, match=r"000001\.bin is gone .*--labels-only"):
        export(store, "s1", tmp_path / "out")


def test_validation_takes_whole_sequences(tmp_path: Path) -> None:
    store = make_store(
        "kitti_validation",
        sequences=[sequence_row(name) for name in "ab"],
        frames=[frame_row(name, n) for name in "ab" for n in range(2)],
        labels=[label_row(name, 0, f"p{name}", 0.5, **box(0, 10)) for name in "ab"],
    )
    options = ExportOptions(validation=("b",), labels_only=True)
    export(store, "s1", tmp_path / "out", options)
    sets = {path.stem: path.read_text() for path in (tmp_path / "out" / "ImageSets").iterdir()}
    assert sets == {"train": "000000\n", "val": "000002\n", "trainval": "000000\n000002\n"}
    with pytest.raises(SettingsError, match=r"names 'c', .* there are a, b"):
        export(store, "s1", tmp_path / "c", ExportOptions(validation=("c",), labels_only=True))


def test_a_former_export_leaves_nothing_behind_and_other_files_stay(tmp_path: Path) -> None:
    labels = [label_row(SEQUENCE, n, f"p{n}", 0.5, **AHEAD) for n in range(3)]
    out = tmp_path / "out"
    export(kitti_store(tmp_path / "long", labels), "s1", out)
    other = out / "training" / "label_2" / "000009.txt"
    other.write_text("another's")
    sweep = (tmp_path / "long/training/velodyne/0000/000000.bin").read_bytes()
    short = kitti_store(tmp_path / "short", labels[:1], frames=1)
    with pytest.raises(TcrdataError, match="not empty"):
        export(short, "s1", out)
    export(short, "s1", out, ExportOptions(overwrite=True, labels_only=True))
    assert sorted(path.name for path in (out / "training" / "label_2").iterdir()) == [
        "000000.txt",
        "000009.txt",
    ]
    assert list((out / "training" / "velodyne").iterdir()) == []
    assert (tmp_path / "long/training/velodyne/0000/000000.bin").read_bytes() == sweep


def test_frames_without_a_camera_keep_their_labels(tmp_path: Path) -> None:
    bare = {"projection": None, "width_px": None, "height_px": None, "has_image": False}
    store = make_store(
        "kitti_bare",
        sequences=[sequence_row("0000")],
        frames=[frame_row("0000", 0) | bare],
        labels=[label_row("0000", 0, "p", 0.5, **(AHEAD | dict.fromkeys(NAMED)))],
    )
    export(store, "s1", tmp_path, ONLY_LABELS)
    (row,) = parse(tmp_path / "training/label_2/000000.txt")
    assert row["box_2d"] == [-1.0] * 4
    unit = calibration(tmp_path / "training/calib/000000.txt")["P2"]
    np.testing.assert_array_equal(unit.reshape(3, 4), np.eye(3, 4))


def test_what_cannot_be_exported(tmp_path: Path) -> None:
    unseen = AHEAD | dict.fromkeys(NAMED) | {"z_m": -10.0}
    store = kitti_store(tmp_path / "kitti", [label_row(SEQUENCE, 0, "p", 0.9, **unseen)])
    with pytest.raises(MissingEvidenceError, match=r"none shows one of the 1 labels.* funnel"):
        export(store, "s1", tmp_path / "out", ONLY_LABELS)
    assert not (tmp_path / "out").exists()
    with pytest.raises(TcrdataError, match=r"no type 'Person': choose one of .*Person_sitting"):
        export(store, "s1", tmp_path / "out", ExportOptions(category="Person"))
