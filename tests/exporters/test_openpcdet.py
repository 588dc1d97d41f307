"""What OpenPCDet's CustomDataset needs of its files, and one box worked out by hand.

The reader takes a label line's last word as the name and the rest as numbers, wants at least one
box in every frame of a split, and takes the order of infos and `ImageSets` for the same.
"""

from __future__ import annotations

import math
import pickle
import pickletools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_worlds import assert_same_boxes, boxes_of, kitti_store, random_labels
from kitti_tree import LEVEL_T_SENSOR, SEQUENCE, sweep
from label_worlds import frame_row, label_row, make_store, sequence_row

from tcrdata.errors import TcrdataError
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.openpcdet import export

STRAIGHT = {
    "x_m": 10.0,
    "y_m": 0.75,
    "z_m": 20.0,
    "length_m": 4.0,
    "width_m": 2.0,
    "height_m": 1.5,
    "yaw_rad": 0.0,  # to the right
}


def depth_store(labels: list[dict[str, Any]]) -> Any:
    return make_store(
        f"openpcdet{len(labels)}",
        sequences=[sequence_row("0000", "depth")],
        frames=[frame_row("0000", 0)],
        labels=labels,
    )


def read_labels(path: Path) -> tuple[np.ndarray, list[str]]:
    lines = [line.strip().split(" ") for line in path.read_text().splitlines()]
    return np.array([line[:-1] for line in lines], dtype=np.float32), [line[-1] for line in lines]


def to_level(boxes: np.ndarray) -> np.ndarray:
    """Back from the generated drive's LiDAR frame: its axes are the camera's, turned."""
    center = boxes[:, :3] @ LEVEL_T_SENSOR[:3, :3].T + LEVEL_T_SENSOR[:3, 3]
    return np.column_stack([center, boxes[:, 3:6], -boxes[:, 6] - math.pi / 2])


def test_one_box_by_hand(tmp_path: Path) -> None:
    store = depth_store([label_row("0000", 0, "p", 0.9, **STRAIGHT)])
    card = export(store, "s1", tmp_path, ExportOptions(labels_only=True, category="Vehicle"))
    # x forward = z, y left = -x, z up = -y; a heading to the right is -pi/2.
    assert (tmp_path / "labels/000000.txt").read_text() == (
        "20.000000 -10.000000 -0.750000 4.000000 2.000000 1.500000 -1.570796 Vehicle\n"
    )
    assert "geometric centre" in card.text()
    assert "-(pi/2 + ry)" in card.text()


def test_round_trip_of_files_and_infos(tmp_path: Path) -> None:
    labels = random_labels(SEQUENCE, 30, 2)
    export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out")
    out = tmp_path / "out"
    expected = boxes_of(labels)
    infos = pickle.loads((out / "custom_infos_train.pkl").read_bytes())
    names = (out / "ImageSets" / "train.txt").read_text().split()
    assert [info["point_cloud"]["lidar_idx"] for info in infos] == names == ["000000", "000001"]
    from_files = [read_labels(out / "labels" / f"{name}.txt") for name in names]
    assert_same_boxes(to_level(np.concatenate([boxes for boxes, _ in from_files])), expected)
    from_infos = np.concatenate([info["annos"]["gt_boxes_lidar"] for info in infos])
    assert_same_boxes(to_level(from_infos), expected)
    for info, (boxes, categories) in zip(infos, from_files, strict=True):
        assert info["point_cloud"]["num_features"] == 4
        assert info["annos"]["name"].tolist() == categories
        assert info["annos"]["gt_boxes_lidar"].dtype == np.float32
        np.testing.assert_allclose(info["annos"]["gt_boxes_lidar"], boxes, atol=1e-5)
    assert pickle.loads((out / "custom_infos_val.pkl").read_bytes()) == []


def test_points_are_the_sensors_own(tmp_path: Path) -> None:
    labels = random_labels(SEQUENCE, 3, 3)
    export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out")
    points = np.load(tmp_path / "out" / "points" / "000002.npy")
    assert points.dtype == np.float32
    np.testing.assert_allclose(points, sweep(2), atol=1e-4)


def test_infos_name_no_module_that_another_numpy_lacks(tmp_path: Path) -> None:
    labels = random_labels(SEQUENCE, 3, 3)
    export(kitti_store(tmp_path / "kitti", labels), "s1", tmp_path / "out")
    data = (tmp_path / "out" / "custom_infos_train.pkl").read_bytes()
    texts = {arg for _, arg, _ in pickletools.genops(data) if isinstance(arg, str)}
    assert "numpy" in texts
    assert not any(text.startswith("numpy.") for text in texts)


def test_undecided_labels_stand_aside(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "p", 0.9, **STRAIGHT),
        label_row("0000", 0, "i", 0.5, state="ignore", **STRAIGHT),
    ]
    card = export(depth_store(labels), "s1", tmp_path / "keep", ExportOptions(labels_only=True))
    assert read_labels(tmp_path / "keep/labels/000000.txt")[1] == ["Car"]
    boxes, names = read_labels(tmp_path / "keep/ignored/000000.txt")
    assert (len(boxes), names) == (1, ["DontCare"])
    (info,) = pickle.loads((tmp_path / "keep" / "custom_infos_train.pkl").read_bytes())
    assert info["annos"]["name"].tolist() == ["Car"]
    assert card.ignored == 1
    drop = ExportOptions(labels_only=True, ignore="drop")
    assert export(depth_store(labels), "s1", tmp_path / "drop", drop).ignored == 0
    assert list((tmp_path / "drop" / "ignored").iterdir()) == []


def test_frames_without_labels_are_in_no_split(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", random_labels(SEQUENCE, 1, 1))
    export(store, "s1", tmp_path / "out", ExportOptions(labels_only=True))
    assert (tmp_path / "out" / "ImageSets" / "trainval.txt").read_text() == "000000\n"
    assert (tmp_path / "out" / "labels" / "000002.txt").read_text() == ""


def test_categories_that_the_reader_would_split_or_drop(tmp_path: Path) -> None:
    store = depth_store([label_row("0000", 0, "p", 0.9, **STRAIGHT)])
    for category in ("a car", "", "DontCare"):
        with pytest.raises(TcrdataError, match="cannot read the category"):
            export(store, "s1", tmp_path, ExportOptions(category=category))
