"""nuScenes tables checked against the schema, and boxes carried back along the chain of tokens.

Fields and references: docs/schema_nuscenes.md of nuscenes-devkit, which needs numpy below 2.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_worlds import BOX, drive, random_labels
from label_worlds import box, frame_row, label_row, make_store, sequence_row
from PIL import Image
from scipy.spatial.transform import Rotation

from tcrdata.datasets.street import open_dataset
from tcrdata.errors import MissingEvidenceError, TcrdataError
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.nuscenes import export

SCHEMA = {
    "category": "token name description",
    "attribute": "token name description",
    "visibility": "token level description",
    "sensor": "token channel modality",
    "log": "token logfile vehicle date_captured location",
    "map": "token log_tokens category filename",
    "scene": "token name description log_token nbr_samples first_sample_token last_sample_token",
    "sample": "token timestamp scene_token next prev",
    "ego_pose": "token translation rotation timestamp",
    "calibrated_sensor": "token sensor_token translation rotation camera_intrinsic",
    "sample_data": "token sample_token ego_pose_token calibrated_sensor_token filename fileformat "
    "width height timestamp is_key_frame next prev",
    "instance": "token category_token nbr_annotations first_annotation_token last_annotation_token",
    "sample_annotation": "token sample_token instance_token attribute_tokens visibility_token "
    "translation size rotation num_lidar_pts num_radar_pts next prev",
}
POINTED = {"prev": None, "next": None, "first_annotation": "sample_annotation",
           "last_annotation": "sample_annotation", "first_sample": "sample",
           "last_sample": "sample"}  # fmt: skip
Tables = dict[str, dict[str, dict[str, Any]]]


def load(out: Path) -> Tables:
    """Each table by token; every field and reference is checked."""
    folder = out / "v1.0-trainval"
    assert {path.stem for path in folder.iterdir()} == set(SCHEMA)
    rows = {name: json.loads((folder / f"{name}.json").read_text()) for name in SCHEMA}
    tables = {name: {row["token"]: row for row in found} for name, found in rows.items()}
    for name, found in rows.items():
        assert len(tables[name]) == len(found), f"{name}: tokens repeat"
        for row in found:
            assert set(row) == set(SCHEMA[name].split()), name
            for field, value in row.items():
                check_reference(tables, name, field, value)
    assert (out / rows["map"][0]["filename"]).is_file()
    return tables


def check_reference(tables: Tables, name: str, field: str, value: Any) -> None:
    if field in ("prev", "next"):
        assert value == "" or value in tables[name]
    elif field.endswith("_tokens"):
        assert set(value) <= set(tables[field.removesuffix("_tokens")])
    elif field.endswith("_token"):
        other = field.removesuffix("_token")
        other = POINTED.get(other) or other
        assert value in tables[other] or (other == "visibility" and value == "")


def matrix(row: dict[str, Any]) -> np.ndarray[Any, Any]:
    """The pose of a row with translation and rotation."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(row["rotation"], scalar_first=True).as_matrix()
    result[:3, 3] = row["translation"]
    return result


def data_of(tables: Tables, sample: str, channel: str) -> dict[str, Any]:
    for row in tables["sample_data"].values():
        calibrated = tables["calibrated_sensor"][row["calibrated_sensor_token"]]
        own = tables["sensor"][calibrated["sensor_token"]]["channel"]
        if (row["sample_token"], own) == (sample, channel):
            return row
    raise AssertionError(f"sample {sample} has no {channel}")


def motion(frame: int, forward_m: float, turn_rad: float = 0.0) -> dict[str, Any]:
    """The ego drives forward, then turns right (about y, down): points come nearer."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    from_T_to = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, forward_m], [0, 0, 0, 1]])
    return {
        "sequence": "0000", "frame": frame, "frame_to": frame + 1, "method": "odometry",
        "to_T_from": np.linalg.inv(from_T_to).ravel().tolist(),
    }  # fmt: skip


MOTIONS = [motion(0, 2.0), motion(1, 3.0, 0.1)]


def test_one_box_by_hand(tmp_path: Path) -> None:
    place = box(10.0, 20.0, yaw=-math.pi / 2) | {"y_m": 0.75}  # straight ahead
    place |= {"number_of_points": 7, "occluded_share": 0.5, "speed_mps": 3.0}
    store = drive(tmp_path, [label_row("0000", 1, "p", 0.9, **place)], egomotions=MOTIONS)
    card = export(store, "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    (found,) = tables["sample_annotation"].values()
    # Frame 1 is 2 m ahead of frame 0: forward 20 + 2, right 10, and 0.75 m below the camera.
    assert found["translation"] == pytest.approx([22.0, -10.0, -0.75], abs=1e-9)
    assert found["size"] == [2.0, 4.0, 1.5]  # width, length, height
    assert found["rotation"] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-9)
    assert (found["num_lidar_pts"], found["prev"], found["next"]) == (7, "", "")
    assert tables["visibility"][found["visibility_token"]]["level"] == "v40-60"
    (attribute,) = found["attribute_tokens"]
    assert tables["attribute"][attribute]["name"] == "vehicle.moving"
    instance = tables["instance"][found["instance_token"]]
    assert tables["category"][instance["category_token"]]["name"] == "vehicle.car"
    assert tables["sample"][found["sample_token"]]["timestamp"] == 100_000  # microseconds
    assert (card.labels, card.files) == (1, 13 + 1 + 3)
    assert "width length height; rotation is w x y z" in card.text()


def test_a_box_to_the_right_after_a_turn(tmp_path: Path) -> None:
    labels = [label_row("0000", 2, "p", 0.9, **box(0.0, 10.0, yaw=0.0))]
    turned = [motion(0, 2.0), motion(1, 3.0, math.pi / 2)]
    export(drive(tmp_path, labels, egomotions=turned), "s1", tmp_path / "out")
    (found,) = load(tmp_path / "out")["sample_annotation"].values()
    # 5 m ahead of the start the ego looks right, along -y; a box 10 m ahead of it that heads
    # right of it heads back, along -x.
    assert found["translation"] == pytest.approx([5.0, -10.0, -1.0], abs=1e-9)
    forward = Rotation.from_quat(found["rotation"], scalar_first=True).apply([1.0, 0.0, 0.0])
    assert forward == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)


def test_round_trip_through_camera_and_ego(tmp_path: Path) -> None:
    labels = random_labels(12)
    export(drive(tmp_path, labels, egomotions=MOTIONS), "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    got = []
    for row in tables["sample_annotation"].values():
        data = data_of(tables, row["sample_token"], "CAM_FRONT")
        calibrated = tables["calibrated_sensor"][data["calibrated_sensor_token"]]
        global_T_camera = matrix(tables["ego_pose"][data["ego_pose_token"]]) @ matrix(calibrated)
        own = np.linalg.inv(global_T_camera) @ matrix(row)
        width, length, height = row["size"]
        yaw = math.atan2(-own[2, 0], own[0, 0])
        got.append([*own[:3, 3], length, width, height, yaw])
        assert calibrated["camera_intrinsic"] == [[700, 0, 600], [0, 700, 180], [0, 0, 1]]
    expected = [[label[name] for name in BOX] for label in labels]
    np.testing.assert_allclose(sorted(got), sorted(expected), atol=1e-4)


def test_samples_and_instances_are_chains(tmp_path: Path) -> None:
    labels = [
        label_row("0000", frame, f"p{frame}", 0.9, track_id="t", **box(0, 10)) for frame in (0, 2)
    ]
    labels.append(label_row("0000", 2, "q", 0.8, track_id="t", **box(3, 10)))
    export(drive(tmp_path, labels, egomotions=MOTIONS), "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    (scene,) = tables["scene"].values()
    assert scene["nbr_samples"] == 3  # frame 1 has no label
    place, frames = scene["first_sample_token"], []
    while place:
        frames.append(tables["sample"][place]["timestamp"])
        place = tables["sample"][place]["next"]
    assert frames == [0, 100_000, 200_000]
    lone, chain = sorted(tables["instance"].values(), key=lambda row: row["nbr_annotations"])
    first = tables["sample_annotation"][chain["first_annotation_token"]]
    assert first["next"] == chain["last_annotation_token"]
    assert tables["sample_annotation"][first["next"]]["prev"] == first["token"]
    assert lone["nbr_annotations"] == 1  # the less sure of two labels of a track in a frame


def test_a_scene_ends_where_egomotion_is_missing(tmp_path: Path) -> None:
    labels = [
        label_row("0000", frame, f"p{frame}", 0.9, track_id="t", **box(0, 10)) for frame in range(3)
    ]
    store = drive(
        tmp_path, labels, egomotions=[motion(0, 2.0), motion(1, 3.0) | {"to_T_from": None}]
    )
    card = export(store, "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    assert [(s["name"], s["nbr_samples"]) for s in tables["scene"].values()] == [
        ("0000", 2), ("0000-2", 1)
    ]  # fmt: skip
    assert sorted(row["nbr_annotations"] for row in tables["instance"].values()) == [1, 2]
    last = [row for row in tables["sample_annotation"].values() if row["translation"][0] == 10.0]
    assert len(last) == 2  # frame 0's, and frame 2's in a global frame of its own
    assert "scenes" in card.text()


def test_a_static_camera_needs_no_egomotion(tmp_path: Path) -> None:
    labels = random_labels(4)
    with pytest.raises(MissingEvidenceError, match="read no egomotion"):
        export(drive(tmp_path, labels), "s1", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    export(drive(tmp_path, labels, static=True), "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    assert len(tables["scene"]) == 1
    assert all(row["translation"] == [0.0] * 3 for row in tables["ego_pose"].values())


def test_ignore_regions_have_a_category_of_their_own_or_are_dropped(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(12), static=True)
    for option, expected in (("keep", 3), ("drop", 0)):
        out = tmp_path / option
        card = export(store, "s1", out, ExportOptions(ignore=option))  # type: ignore[arg-type]
        tables = load(out)
        names = []
        for row in tables["sample_annotation"].values():
            kind = tables["instance"][row["instance_token"]]["category_token"]
            names.append(tables["category"][kind]["name"])
        assert names.count("noise") == card.ignored == expected
        assert names.count("vehicle.car") == card.labels == 9


def test_generated_images_and_points_become_files(tmp_path: Path) -> None:
    root, frame = "seed=1,frames=1", {"has_image": True, "number_of_points": 1}
    dataset = open_dataset(root)
    (source,) = dataset.frames("drive_0000")
    pose = {"level_T_sensor": source.sensor_matrix.ravel().tolist()}
    row = sequence_row("drive_0000") | {"root": root, "static_camera": True}
    store = make_store(
        "generated",
        dataset="street",
        sequences=[row],
        frames=[frame_row("drive_0000", 0) | frame | pose],
        labels=[label_row("drive_0000", 0, "p", 0.9, **box(0, 10))],
    )
    card = export(store, "s1", tmp_path / "out")
    tables = load(tmp_path / "out")
    (sample,) = tables["sample"]
    image = tmp_path / "out" / data_of(tables, sample, "CAM_FRONT")["filename"]
    np.testing.assert_array_equal(np.asarray(Image.open(image)), dataset.read_image(source))
    data = data_of(tables, sample, "LIDAR_TOP")
    found = np.fromfile(tmp_path / "out" / data["filename"], "<f4").reshape(-1, 5)
    cloud = dataset.read_points(source)
    ego_T_lidar = matrix(tables["calibrated_sensor"][data["calibrated_sensor_token"]])
    ego = found[:, :3] @ ego_T_lidar[:3, :3].T + ego_T_lidar[:3, 3]
    # Ego x forward, y left, z up; level x right, y down, z forward.
    np.testing.assert_allclose(ego, cloud.xyz[:, [2, 0, 1]] * [1, -1, -1], atol=1e-4)
    np.testing.assert_allclose(found[:, 3], cloud.reflectance * 255, atol=1e-3)
    assert card.files == 13 + 1 + 2
    export(store, "s1", tmp_path / "bare", ExportOptions(labels_only=True))
    assert not (tmp_path / "bare" / "samples").exists()


def test_a_drive_without_images_has_no_camera_data(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3), images=False, static=True)
    export(store, "s1", tmp_path / "out", ExportOptions(category="Pedestrian"))
    tables = load(tmp_path / "out")
    assert tables["sample_data"] == {}
    assert len(tables["sample"]) == 3
    assert "human.pedestrian.adult" in {row["name"] for row in tables["category"].values()}


def test_equal_exports_are_equal_and_a_full_folder_is_refused(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(6), static=True)
    for name in ("a", "b"):
        export(store, "s1", tmp_path / name)
    for table in SCHEMA:
        path = f"v1.0-trainval/{table}.json"
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes()
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path / "a")
