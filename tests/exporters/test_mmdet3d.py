"""What MMDetection3D's KittiDataset needs of its infos, and one box worked out by hand.

The reader takes the keys of a frame's first instance for those of all, maps labels by `metainfo`,
drops label -1, and turns boxes of the camera frame with the inverse of `lidar2cam`.
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
from kitti_tree import HEIGHT_PX, LEVEL_T_SENSOR, P2, SEQUENCE, WIDTH_PX
from label_worlds import label_row
from scipy.spatial.transform import Rotation

from tcrdata.errors import TcrdataError
from tcrdata.exporters.cameras import standing_boxes, wrapped
from tcrdata.exporters.frame_points import lidar_boxes
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.mmdet3d import export

AHEAD = {
    "x_m": 1.0,
    "y_m": 0.75,
    "z_m": 10.0,
    "length_m": 4.0,
    "width_m": 2.0,
    "height_m": 1.5,
    "yaw_rad": -math.pi / 2,  # straight ahead
    "left_px": 60.0,
    "top_px": 0.5,
    "right_px": 100.0,
    "bottom_px": 46.0,
    "truncated_share": 0.1,
    "occluded_share": 0.0,
    "number_of_points": 321,
}


def read(folder: Path, split: str = "train") -> Any:
    return pickle.loads((folder / f"kitti_infos_{split}.pkl").read_bytes())


def test_one_box_by_hand(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", [label_row(SEQUENCE, 1, "p", 0.875, **AHEAD)])
    card = export(store, "s1", tmp_path / "out")
    content = read(tmp_path / "out")
    assert content["metainfo"]["categories"]["Car"] == 2
    assert content["metainfo"]["categories"]["DontCare"] == -1
    (info,) = content["data_list"]
    (instance,) = info["instances"]
    assert instance["bbox_3d"] == pytest.approx([1, 1.5, 10, 4, 1.5, 2, -math.pi / 2], abs=1e-9)
    assert instance["bbox"] == [60.0, 0.5, 100.0, 46.0]
    assert (instance["bbox_label"], instance["bbox_label_3d"]) == (2, 2)
    assert instance["alpha"] == pytest.approx(-math.pi / 2 - math.atan2(1, 10))
    assert instance["depth"] == pytest.approx(10.0027)
    # The centre's pixel: (93 * 1 + 79.5 * 10 + 5.8) / 10.0027, (93 * 0.75 + 22 * 10 + 0.03) / ...
    assert instance["center_2d"] == pytest.approx([893.8 / 10.0027, 289.78 / 10.0027])
    assert (instance["truncated"], instance["occluded"], instance["difficulty"]) == (0.1, 0, 0)
    assert (instance["num_lidar_pts"], instance["score"]) == (321, 0.875)
    assert "length height width" in card.text()


def test_a_frame_names_its_files_and_matrices(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", [label_row(SEQUENCE, 1, "p", 0.9, **AHEAD)])
    export(store, "s1", tmp_path / "out")
    (info,) = read(tmp_path / "out")["data_list"]
    camera = info["images"]["CAM2"]
    assert (camera["img_path"], info["lidar_points"]["lidar_path"]) == ("000001.png", "000001.bin")
    assert (tmp_path / "out/training/image_2/000001.png").is_file()
    assert (tmp_path / "out/training/velodyne/000001.bin").stat().st_size % 16 == 0
    assert (camera["height"], camera["width"]) == (HEIGHT_PX, WIDTH_PX)
    np.testing.assert_allclose(camera["lidar2cam"], LEVEL_T_SENSOR, atol=1e-9)
    np.testing.assert_allclose(camera["cam2img"], np.vstack([P2, [0, 0, 0, 1]]), atol=1e-9)
    np.testing.assert_allclose(
        camera["lidar2img"], np.array(camera["cam2img"]) @ camera["lidar2cam"], atol=1e-9
    )
    assert info["lidar_points"]["num_pts_feats"] == 4


def test_round_trip(tmp_path: Path) -> None:
    labels = random_labels(SEQUENCE, 30, 3)
    store = kitti_store(tmp_path / "kitti", labels)
    export(store, "s1", tmp_path / "out", ExportOptions(labels_only=True))
    frames = read(tmp_path / "out")["data_list"]
    boxes = np.array([i["bbox_3d"] for info in frames for i in info["instances"]])
    x, y, z, length, height, width, yaw = boxes.T
    found = np.column_stack([x, y - height / 2, z, length, width, height, yaw])
    assert_same_boxes(found, boxes_of(labels))
    assert [info["sample_idx"] for info in frames] == [0, 1, 2]
    assert {tuple(i) for info in frames for i in info["instances"]} == {
        tuple(frames[0]["instances"][0])
    }
    assert [i["index"] for i in frames[1]["instances"]] == list(range(10))


def test_boxes_of_a_tilted_camera_are_exact_in_the_lidar_frame() -> None:
    """The reader: points of the camera go through inverse(lidar2cam), yaw is -(pi/2) - yaw."""
    camera_T_level = np.eye(4)
    camera_T_level[:3, :3] = Rotation.from_euler("xz", [0.4, -0.1]).as_matrix()
    camera_T_level[:3, 3] = [0.1, -0.2, 0.3]
    lidar_T_level = np.eye(4)[[2, 0, 1, 3]] * np.array([[1], [-1], [-1], [1]])
    boxes = np.array([[1.0, 0.5, 9.0, 4.0, 1.8, 1.5, 0.7], [-3.0, 1.0, 20.0, 4.5, 2.0, 2.5, -3.0]])
    found = standing_boxes(boxes, np.broadcast_to(camera_T_level, (2, 4, 4)))
    level = (found[:, :3] - camera_T_level[:3, 3]) @ camera_T_level[:3, :3]
    read = level @ lidar_T_level[:3, :3].T + found[:, 4:5] * np.array([0, 0, 0.5])
    exact = lidar_boxes(boxes, np.broadcast_to(lidar_T_level, (2, 4, 4)))
    np.testing.assert_allclose(read, exact[:, :3], atol=1e-9)
    np.testing.assert_allclose(wrapped(-np.pi / 2 - found[:, 6]), exact[:, 6], atol=1e-9)
    np.testing.assert_array_equal(found[:, 3:6], boxes[:, [3, 5, 4]])


def test_undecided_labels_have_label_minus_one(tmp_path: Path) -> None:
    labels = [
        label_row(SEQUENCE, 0, "p", 0.9, **AHEAD),
        label_row(SEQUENCE, 0, "i", 0.5, state="ignore", **AHEAD),
        label_row(SEQUENCE, 2, "alone", 0.5, state="ignore", **AHEAD),
    ]
    store = kitti_store(tmp_path / "kitti", labels)
    card = export(store, "s1", tmp_path / "keep", ExportOptions(labels_only=True))
    (info,) = read(tmp_path / "keep")["data_list"]
    assert [i["bbox_label_3d"] for i in info["instances"]] == [2, -1]
    assert [i["bbox_label"] for i in info["instances"]] == [2, -1]
    assert card.ignored == 1  # a frame of ignore regions alone is in no split
    export(store, "s1", tmp_path / "drop", ExportOptions(labels_only=True, ignore="drop"))
    (info,) = read(tmp_path / "drop")["data_list"]
    assert [i["bbox_label_3d"] for i in info["instances"]] == [2]


def test_infos_are_plain_values(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", random_labels(SEQUENCE, 6, 3))
    export(store, "s1", tmp_path / "out", ExportOptions(labels_only=True))
    data = (tmp_path / "out" / "kitti_infos_train.pkl").read_bytes()
    operations = {operation.name for operation, _, _ in pickletools.genops(data)}
    assert not operations & {"GLOBAL", "STACK_GLOBAL", "REDUCE"}


def test_a_category_that_the_reader_does_not_know(tmp_path: Path) -> None:
    store = kitti_store(tmp_path / "kitti", random_labels(SEQUENCE, 1, 1))
    with pytest.raises(TcrdataError, match="no type 'Vehicle'"):
        export(store, "s1", tmp_path / "out", ExportOptions(category="Vehicle"))
