from __future__ import annotations

import pickle
import time
from collections import defaultdict
from typing import Any

import numpy as np
import pytest

from tcrdata.datasets.demo import Demo, open_dataset
from tcrdata.errors import DatasetError
from tcrdata.geometry.transforms import level_project

CLIP = "table_0000"


@pytest.fixture(scope="module")
def demo() -> Demo:
    return open_dataset()


@pytest.fixture(scope="module")
def truth(demo: Demo) -> dict[str, list[dict[str, Any]]]:
    rows = defaultdict(list)
    for row in demo.ground_truth(CLIP):
        rows[row["object_id"]].append(row)
    return rows


def test_the_root_is_the_spec_written_out() -> None:
    assert (
        open_dataset().root == open_dataset("").root == "seed=1,frames=50,sequences=1,noise_m=0.01"
    )
    demo = open_dataset(" frames=3, seed=9,sequences=2")
    assert demo.root == "seed=9,frames=3,sequences=2,noise_m=0.01"
    assert open_dataset(demo.root) == demo == pickle.loads(pickle.dumps(demo))
    assert demo.sequences() == ["table_0000", "table_0001"]
    assert [frame.frame for frame in demo.frames("table_0001")] == [0, 1, 2]


@pytest.mark.parametrize(
    "spec", ["seed", "seed=x", "seed=-1", "frames=0", "colour=3", "seed=1,seed=2", "noise_m=nan"]
)
def test_a_malformed_spec_is_named(spec: str) -> None:
    with pytest.raises(DatasetError, match="demo dataset's root"):
        open_dataset(spec)


def test_an_unknown_clip_is_named(demo: Demo) -> None:
    with pytest.raises(DatasetError, match="table_0007"):
        demo.frames("table_0007")


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(demo: Demo) -> None:
    frame = demo.frames(CLIP)[7]
    again, other = open_dataset(), open_dataset("seed=2")
    assert np.array_equal(demo.read_image(frame), again.read_image(frame))
    assert np.array_equal(demo.read_points(frame).xyz, again.read_points(frame).xyz)
    assert not np.array_equal(demo.read_image(frame), other.read_image(frame))
    assert demo.info(CLIP).fingerprint != other.info(CLIP).fingerprint
    assert demo.ground_truth(CLIP)[:3] == again.ground_truth(CLIP)[:3]
    two = open_dataset("sequences=2").ground_truth("table_0001")
    assert two[0]["x_m"] != demo.ground_truth(CLIP)[0]["x_m"]


def test_points_project_onto_their_pixels_and_lie_on_the_table(demo: Demo) -> None:
    frame = demo.frames(CLIP)[0]
    cloud = demo.read_points(frame)
    projection = frame.level_projection
    assert projection is not None
    assert cloud.pixels is not None
    pixels, depth = level_project(projection, cloud.xyz)
    np.testing.assert_allclose(pixels, cloud.pixels, atol=1e-3)
    exact, owners = demo.exact_depth(frame)
    noise = depth - exact[cloud.pixels[:, 1], cloud.pixels[:, 0]]
    assert noise.std() == pytest.approx(0.01, rel=0.05)
    on_table = owners[cloud.pixels[:, 1], cloud.pixels[:, 0]] == -1
    # The camera is 5.34 above the table; depth noise moves a point along its ray.
    assert np.abs(cloud.xyz[on_table, 1] - 5.34).max() < 0.05
    assert cloud.xyz[~on_table, 1].max() < 5.34 + 0.05


def test_depth_alone_is_exact(demo: Demo) -> None:
    exact = open_dataset("noise_m=0")
    frame = exact.frames(CLIP)[0]
    depth, owners = exact.exact_depth(frame)
    cloud = exact.read_points(frame)
    assert cloud.pixels is not None
    table = owners[cloud.pixels[:, 1], cloud.pixels[:, 0]] == -1
    np.testing.assert_allclose(cloud.xyz[table, 1], 5.34, atol=1e-5)
    for row in (r for r in exact.ground_truth(CLIP) if r["frame"] == 0):
        if row["category"] != "sphere":
            continue
        number = int(row["object_id"][:2])
        seen = owners[cloud.pixels[:, 1], cloud.pixels[:, 0]] == number
        centre = np.array([row["x_m"], row["y_m"], row["z_m"]])
        distances = np.linalg.norm(cloud.xyz[seen] - centre, axis=1)
        np.testing.assert_allclose(distances, 0.5 * row["length_m"], atol=1e-5)
    assert depth.shape == owners.shape == (240, 320)


def test_points_of_an_object_lie_in_its_box(
    demo: Demo, truth: dict[str, list[dict[str, Any]]]
) -> None:
    exact = open_dataset("noise_m=0")
    checked = 0
    for number in (0, 20, 49):
        frame = exact.frames(CLIP)[number]
        cloud = exact.read_points(frame)
        _, owners = exact.exact_depth(frame)
        assert cloud.pixels is not None
        seen = owners[cloud.pixels[:, 1], cloud.pixels[:, 0]]
        for index, rows in enumerate(truth.values()):
            row, points = rows[number], cloud.xyz[seen == index]
            points = points - (row["x_m"], row["y_m"], row["z_m"])
            full = points @ np.reshape(row["level_R_object"], (3, 3))
            assert np.all(np.abs(full) <= 0.5 * np.array(row["object_size_m"]) + 1e-4)
            c, s = np.cos(row["yaw_rad"]), np.sin(row["yaw_rad"])
            upright = points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
            size = np.array([row["length_m"], row["height_m"], row["width_m"]])
            assert np.all(np.abs(upright) <= 0.5 * size + 2e-3)
            checked += len(points) > 0
    assert checked > 12


def test_flow_is_that_of_projected_points(demo: Demo, truth: dict[str, Any]) -> None:
    frames = demo.frames(CLIP)
    flow = demo.exact_flow(frames[20], frames[21])
    _, owners = demo.exact_depth(frames[20])
    depth, _ = demo.exact_depth(frames[20])
    camera = np.array([[350.0, 0, 160], [0, 350.0, 120], [0, 0, 1]])
    level_T_camera = frames[20].sensor_matrix
    assert np.all(flow[owners == -1] == pytest.approx(0, abs=1e-4))
    moved = 0
    for index, rows in enumerate(truth.values()):
        v, u = np.nonzero(owners == index)
        if not len(v):
            continue
        rays = np.stack([u, v, np.ones_like(u)]).T @ np.linalg.inv(camera).T
        points = (rays * depth[v, u, None]) @ level_T_camera[:3, :3].T
        a, b = _pose(rows[20]), _pose(rows[21])
        points = (points - a[:3, 3]) @ a[:3, :3] @ b[:3, :3].T + b[:3, 3]
        pixels = points @ level_T_camera[:3, :3] @ camera.T
        expected = pixels[:, :2] / pixels[:, 2:] - np.stack([u, v]).T
        np.testing.assert_allclose(flow[v, u], expected, atol=2e-4)
        moved += np.abs(expected).max() > 0.5
    assert moved >= 2


def test_objects_move_stop_tilt_and_hide_one_another(truth: dict[str, Any]) -> None:
    assert 6 <= len(truth) <= 8
    travels, stops, tilts, hidden, still = 0, 0, 0, 0, 0
    for rows in truth.values():
        assert [row["frame"] for row in rows] == list(range(50))
        speeds = np.array([row["speed_mps"] for row in rows])
        path = np.array([(row["x_m"], row["z_m"]) for row in rows])
        travels += np.hypot(*(path[-1] - path[0])) > 1.0
        stops += speeds.max() > 0.5 and speeds[-1] == 0.0
        tilts += any(_tilted(row) for row in rows)
        occluded = np.array([row["occluded"] for row in rows])
        hidden += occluded.max() > 0.5 and occluded.min() < 0.1
        still += bool(speeds.max() == 0.0)
    assert travels >= 3
    assert stops >= 3
    assert tilts == 1
    assert hidden >= 1
    assert still >= 2


@pytest.mark.parametrize("seed", [0, 2, 3, 4])
def test_every_seed_moves_and_hides(seed: int) -> None:
    rows = open_dataset(f"seed={seed},frames=50").ground_truth(CLIP)
    moving = {row["object_id"] for row in rows if row["speed_mps"] > 0.5}
    assert len(moving) >= 3
    assert max(row["occluded"] for row in rows if row["object_id"] in moving) > 0.5
    assert len({row["object_id"] for row in rows}) >= 6


def test_occlusion_agrees_with_the_picture_of_owners(
    demo: Demo, truth: dict[str, list[dict[str, Any]]]
) -> None:
    for number in (0, 13, 30):
        _, owners = demo.exact_depth(demo.frames(CLIP)[number])
        for index, rows in enumerate(truth.values()):
            row, seen = rows[number], owners == index
            assert row["visible_px"] == seen.sum()
            assert 0.0 <= row["occluded"] <= 1.0
            if seen.any():
                v, u = np.nonzero(seen)
                assert row["left_px"] - 0.1 <= u.min()
                assert u.max() <= row["right_px"] + 0.1
                assert row["top_px"] - 0.1 <= v.min()
                assert v.max() <= row["bottom_px"] + 0.1


def test_the_picture_is_bright_and_textured(demo: Demo) -> None:
    image = demo.read_image(demo.frames(CLIP)[0])
    assert image.shape == (240, 320, 3)
    assert image.dtype == np.uint8
    assert 100 < image.mean() < 200
    assert image.std() > 15


def test_a_long_clip_keeps_moving() -> None:
    demo = open_dataset("frames=150")
    rows = [row for row in demo.ground_truth(CLIP) if row["frame"] >= 100]
    assert max(row["speed_mps"] for row in rows) > 0.5


def test_a_frame_is_cheap(demo: Demo) -> None:
    frames = demo.frames(CLIP)
    demo.read_image(frames[0])
    best = min(_seconds(demo, frame) for frame in frames[:4])
    assert best < 0.6  # 50 frames in 30 s


def _seconds(demo: Demo, frame: Any) -> float:
    start = time.thread_time()
    demo.read_image(frame)
    demo.read_points(frame)
    return time.thread_time() - start


def _tilted(row: dict[str, Any]) -> bool:
    return bool(row["level_R_object"][4] < 0.999)


def _pose(row: dict[str, Any]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(row["level_R_object"], (3, 3))
    pose[:3, 3] = row["x_m"], row["y_m"], row["z_m"]
    return pose
