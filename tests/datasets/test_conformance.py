"""What every dataset adapter promises, on a small instance of each."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from kitti_tree import write_raw, write_tracking

from tcrdata import registry
from tcrdata.errors import DatasetError
from tcrdata.geometry.transforms import level_project
from tcrdata.store import schemas
from tcrdata.types import Dataset, Frame

FILLED_IN = {"dataset", "sequence", "round"}


def kitti_raw(folder: Path) -> str:
    write_raw(folder)
    write_raw(folder, drive="2011_09_26_drive_0002_sync", first_frame=100, frames=3)
    return str(folder)


def kitti_tracking(folder: Path) -> str:
    write_tracking(folder)
    write_tracking(folder, sequence="0001", frames=2)
    return str(folder)


def cater_clips(folder: Path) -> str:
    generation = registry.find("datasets", "cater").generate("frames=2,cameras=2", str(folder))
    assert sum(1 for _ in generation.work) == 4
    return str(generation.root)


# One entry an adapter and layout; a new adapter adds its own.
SAMPLES: dict[str, tuple[str, Callable[[Path], str]]] = {
    "kitti raw": ("kitti", kitti_raw),
    "kitti tracking": ("kitti", kitti_tracking),
    "cater": ("cater", lambda _: "frames=4,cameras=2"),
    "cater clips": ("cater", cater_clips),
    "demo": ("demo", lambda _: "frames=4,sequences=2"),
    "street": ("street", lambda _: "frames=3,parked=2,moving=2"),
}


@pytest.fixture(scope="module", params=SAMPLES)
def dataset(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    name, make_root = SAMPLES[request.param]
    root = make_root(tmp_path_factory.mktemp("root"))
    result: Dataset = registry.find("datasets", name).open_dataset(root)
    return result


@pytest.fixture(scope="module")
def frames(dataset: Dataset) -> list[Frame]:
    return dataset.frames(dataset.sequences()[0])


def test_every_adapter_is_tested() -> None:
    assert {name for name, _ in SAMPLES.values()} == set(registry.names("datasets"))


def test_sequences_are_sorted_names_without_repeats(dataset: Dataset) -> None:
    names = dataset.sequences()
    assert names
    assert names == sorted(set(names))


def test_an_unknown_sequence_is_named_with_those_there_are(dataset: Dataset) -> None:
    for ask in (dataset.info, dataset.frames, dataset.ground_truth):
        with pytest.raises(DatasetError) as caught:
            ask("elsewhere")
        assert "elsewhere" in str(caught.value)
        assert dataset.sequences()[0] in str(caught.value)


def test_the_handle_and_its_frames_pickle_lightly(dataset: Dataset, frames: list[Frame]) -> None:
    data = pickle.dumps(dataset)
    assert len(data) < 2_000
    assert pickle.loads(data) == dataset
    assert pickle.loads(pickle.dumps(frames[0])) == frames[0]


def test_info_counts_the_frames(dataset: Dataset) -> None:
    for sequence in dataset.sequences():
        info = dataset.info(sequence)
        assert (info.dataset, info.sequence, info.root) == (dataset.name, sequence, dataset.root)
        assert info.number_of_frames == len(dataset.frames(sequence))
        assert info.metric_scale > 0
        assert len(info.fingerprint) == 64


def test_fingerprints_are_stable_and_differ(dataset: Dataset) -> None:
    names = dataset.sequences()
    fingerprints = [dataset.info(name).fingerprint for name in names]
    assert fingerprints == [dataset.info(name).fingerprint for name in names]
    assert len(set(fingerprints)) == len(names)


def test_frames_and_times_rise(dataset: Dataset) -> None:
    for sequence in dataset.sequences():
        frames = dataset.frames(sequence)
        assert all(frame.status == "ok" and frame.error is None for frame in frames)
        assert (np.diff([frame.frame for frame in frames]) > 0).all()
        assert (np.diff([frame.timestamp_ns for frame in frames]) > 0).all()
        assert {(frame.dataset, frame.sequence) for frame in frames} == {(dataset.name, sequence)}


def test_transforms_are_rigid(frames: list[Frame]) -> None:
    for transform in (frames[0].level_T_sensor, frames[0].camera_T_level):
        matrix = np.asarray(transform)
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-5)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0, abs=1e-5)
        np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])


def test_points_are_finite_float32(dataset: Dataset, frames: list[Frame]) -> None:
    for frame in frames:
        cloud = dataset.read_points(frame)
        assert len(cloud) > 0
        assert cloud.xyz.shape == (len(cloud), 3)
        assert cloud.reflectance.shape == (len(cloud),)
        for values in (cloud.xyz, cloud.reflectance):
            assert values.dtype == np.float32
            assert values.flags.c_contiguous
            assert np.isfinite(values).all()
        assert cloud.reflectance.min() >= 0
        assert cloud.reflectance.max() <= 1
        assert np.linalg.norm(cloud.xyz, axis=1).max() < 200


def test_points_before_the_camera_project_into_the_image(
    dataset: Dataset, frames: list[Frame]
) -> None:
    frame = frames[0]
    cloud, projection = dataset.read_points(frame), frame.level_projection
    assert frame.camera is not None
    assert projection is not None
    pixels, depth = level_project(projection, cloud.xyz)
    size = (frame.camera.width_px, frame.camera.height_px)
    inside = (depth > 0) & (pixels > -0.5).all(axis=1) & (pixels < np.subtract(size, 0.5)).all(1)
    assert inside.mean() > 0.05
    # The ground is below: most points of the lower half are.
    assert np.median(cloud.xyz[:, 1]) > 0
    if cloud.pixels is not None:
        np.testing.assert_allclose(pixels, cloud.pixels, atol=0.05)


def test_images_have_the_camera_s_size(dataset: Dataset, frames: list[Frame]) -> None:
    for frame in frames[:2]:
        image = dataset.read_image(frame)
        assert frame.camera is not None
        assert image.dtype == np.uint8
        assert image.shape == (frame.camera.height_px, frame.camera.width_px, 3)


def test_reading_twice_gives_the_same(dataset: Dataset, frames: list[Frame]) -> None:
    sequence = dataset.sequences()[0]
    again = pickle.loads(pickle.dumps(dataset))
    assert again.frames(sequence) == frames
    first, second = dataset.read_points(frames[1]), again.read_points(frames[1])
    np.testing.assert_array_equal(first.xyz, second.xyz)
    np.testing.assert_array_equal(first.reflectance, second.reflectance)
    np.testing.assert_array_equal(dataset.read_image(frames[1]), again.read_image(frames[1]))
    assert dataset.ground_truth(sequence) == again.ground_truth(sequence)


def test_truth_fits_its_table(dataset: Dataset) -> None:
    columns = {column.name for column in schemas.columns("ground_truth")}
    for sequence in dataset.sequences():
        rows = dataset.ground_truth(sequence)
        assert rows
        numbers = {frame.frame for frame in dataset.frames(sequence)}
        for row in rows:
            assert set(row) | FILLED_IN == columns
            assert row["frame"] in numbers
            check_truth_row(row)
        table = [{**dict.fromkeys(FILLED_IN, "_"), "round": 1, **row} for row in rows]
        pa.Table.from_pylist(table, schema=schemas.arrow_schema("ground_truth")).validate(full=True)
        keys = [(row["frame"], row["object_id"]) for row in rows]
        assert len(keys) == len(set(keys))
        assert [row["frame"] for row in rows] == sorted(row["frame"] for row in rows)


def check_truth_row(row: dict[str, Any]) -> None:
    assert isinstance(row["object_id"], str)
    assert isinstance(row["category"], str)
    assert isinstance(row["yaw_observable"], bool)
    if row["category"] == "DontCare":
        assert row["x_m"] is None
        assert row["level_R_object"] is None
        return
    assert min(row["length_m"], row["width_m"], row["height_m"]) > 0
    rotation = np.array(row["level_R_object"]).reshape(3, 3)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert row["speed_mps"] is None or row["speed_mps"] >= 0


def test_a_truth_box_projects_onto_its_image_box(dataset: Dataset, frames: list[Frame]) -> None:
    by_number = {frame.frame: frame for frame in frames}
    compared = 0
    for row in dataset.ground_truth(dataset.sequences()[0]):
        if row["x_m"] is None or row["left_px"] is None:
            continue
        frame = by_number[row["frame"]]
        outer = project_corners(row, frame)
        assert row["left_px"] >= outer[0] - 2
        assert row["top_px"] >= outer[1] - 2
        assert row["right_px"] <= outer[2] + 2
        assert row["bottom_px"] <= outer[3] + 2
        compared += 1
    assert compared > 0


def project_corners(row: dict[str, Any], frame: Frame) -> np.ndarray:
    """Left, top, right, bottom of the eight corners, rotated by the full rotation."""
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    rotation = np.array(row["level_R_object"]).reshape(3, 3)
    corners = (signs * row["object_size_m"]) @ rotation.T + [row["x_m"], row["y_m"], row["z_m"]]
    assert frame.level_projection is not None
    pixels, _ = level_project(frame.level_projection, corners)
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


@pytest.mark.parametrize("write", [write_raw, write_tracking])
def test_labels_touch_nothing_but_the_truth(write: Callable[..., Path], tmp_path: Path) -> None:
    write(tmp_path)
    dataset: Dataset = registry.find("datasets", "kitti").open_dataset(str(tmp_path))
    sequence = dataset.sequences()[0]
    before = (dataset.info(sequence), dataset.frames(sequence))
    assert dataset.ground_truth(sequence)
    for labels in (*tmp_path.rglob("tracklet_labels.xml"), *tmp_path.rglob("label_02")):
        shutil.rmtree(labels) if labels.is_dir() else labels.unlink()
    for packets in tmp_path.rglob("oxts"):
        shutil.rmtree(packets)
    assert (dataset.info(sequence), dataset.frames(sequence)) == before
    assert dataset.ground_truth(sequence) == []
