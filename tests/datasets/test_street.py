from __future__ import annotations

import itertools
import pickle
from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tcrdata.datasets.street import StreetDrive, open_dataset
from tcrdata.errors import DatasetError, FrameError
from tcrdata.geometry.transforms import inverse, level_project, transform_points

DRIVE = "drive_0000"


@pytest.fixture(scope="module")
def street() -> StreetDrive:
    return open_dataset("frames=30")


@pytest.fixture(scope="module")
def truth(street: StreetDrive) -> dict[str, list[dict[str, Any]]]:
    rows = defaultdict(list)
    for row in street.ground_truth(DRIVE):
        rows[row["object_id"]].append(row)
    return rows


def test_the_root_is_the_spec_written_out(street: StreetDrive) -> None:
    assert street.root == (
        "seed=0,frames=30,speed_mps=8.0,parked=6,moving=4,images=true,noise_m=0.02,dropout=0.03"
    )
    assert open_dataset(street.root) == street == pickle.loads(pickle.dumps(street))


@pytest.mark.parametrize("spec", ["speed_mps=-1", "images=yes", "frames=2.5", "parked=201", "x=1"])
def test_a_malformed_spec_is_named(spec: str) -> None:
    with pytest.raises(DatasetError, match="street dataset's root"):
        open_dataset(spec)


def test_without_images_the_sweeps_stay(street: StreetDrive) -> None:
    blind = open_dataset("frames=30,images=false")
    frame = blind.frames(DRIVE)[2]
    assert not frame.has_image
    with pytest.raises(FrameError, match="images=true"):
        blind.read_image(frame)
    assert np.array_equal(blind.read_points(frame).xyz, street.read_points(frame).xyz)
    assert len(blind.ground_truth(DRIVE)) == len(street.ground_truth(DRIVE))


def test_a_sweep_has_the_geometry_of_a_64_beam_lidar(street: StreetDrive) -> None:
    frame = street.frames(DRIVE)[5]
    cloud = street.read_points(frame)
    assert 100_000 < len(cloud) < 128_000
    sensor = transform_points(inverse(frame.sensor_matrix), cloud.xyz.astype(np.float64))
    ranges = np.linalg.norm(sensor, axis=1)
    pitch = np.degrees(np.arcsin(sensor[:, 2] / ranges))
    assert len(np.unique(np.round(pitch, 2))) >= 60
    assert pitch.max() <= 2.01
    assert pitch.min() == pytest.approx(-24.33, abs=0.01)
    assert ranges.min() >= 0.9
    assert ranges.max() <= 100.0
    assert cloud.reflectance.min() >= 0.0
    assert cloud.reflectance.max() <= 1.0
    # Ground 1.73 m below the sensor, +-3 cm of relief and 2 cm of noise along the ray.
    near = (ranges < 6.0) & (np.abs(sensor[:, 1]) < 1.0)
    assert np.median(sensor[near, 2]) == pytest.approx(-1.726, abs=0.03)


def test_the_same_seed_gives_the_same_sweep_and_another_does_not(street: StreetDrive) -> None:
    frame = street.frames(DRIVE)[3]
    first = street.read_points(frame).xyz
    assert np.array_equal(first, open_dataset("frames=30").read_points(frame).xyz)
    other = open_dataset("frames=30,seed=1").read_points(frame).xyz
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_what_stands_still_stays_in_the_world(street: StreetDrive) -> None:
    still = open_dataset("frames=30,moving=0,noise_m=0,dropout=0")
    frames = still.frames(DRIVE)
    motion = still.exact_egomotion(frames[0], frames[4])
    assert np.linalg.norm(motion[:3, 3]) == pytest.approx(3.2, abs=0.05)
    # Walls, trees and cars: rings on the ground travel with the sensor.
    first = still.read_points(frames[0]).xyz
    first = first[(first[:, 1] < 1.0) & (np.linalg.norm(first, axis=1) < 30.0)][::20]
    tree = cKDTree(still.read_points(frames[4]).xyz)
    right, _ = tree.query(transform_points(motion, first))
    wrong, _ = tree.query(first)
    assert np.median(right) < 0.05
    assert np.mean(right < 0.15) > 0.9
    assert np.mean(wrong < 0.15) < 0.8


@pytest.mark.parametrize("speed", [0.0, 1.5, 8.0, 25.0])
def test_the_own_speed_is_the_specs(speed: float) -> None:
    drive = open_dataset(f"frames=4,speed_mps={speed}")
    frames = drive.frames(DRIVE)
    step = drive.exact_egomotion(frames[1], frames[2])
    # The lane runs inside or outside the arc whose length is the travel.
    assert np.linalg.norm(step[:3, 3]) == pytest.approx(0.1 * speed, rel=0.02, abs=1e-9)
    assert np.allclose(step[:3, :3] @ step[:3, :3].T, np.eye(3))


def test_truth_moves_as_its_speed_says(
    street: StreetDrive, truth: dict[str, list[dict[str, Any]]]
) -> None:
    assert {"Car", "Cyclist"} <= {rows[0]["category"] for rows in truth.values()}
    checked = 0
    for name, rows in truth.items():
        for row, later in itertools.pairwise(rows):
            if later["frame"] != row["frame"] + 1:
                continue
            world = [
                inverse(street.view(r["frame"]).level_T_world) @ (r["x_m"], r["y_m"], r["z_m"], 1.0)
                for r in (row, later)
            ]
            speed = np.linalg.norm(world[1] - world[0]) / 0.1
            assert speed == pytest.approx(row["speed_mps"], abs=0.02)
            assert (speed > 0.5) == name.startswith("moving")
            checked += 1
    assert checked > 100


def test_the_heading_is_where_it_goes(
    street: StreetDrive, truth: dict[str, list[dict[str, Any]]]
) -> None:
    rows = truth["moving_01"]
    for row, later in itertools.pairwise(rows):
        back = street.exact_egomotion(*(street.frames(DRIVE)[r["frame"]] for r in (later, row)))
        step = back @ (later["x_m"], later["y_m"], later["z_m"], 1.0)
        step = step[:3] - (row["x_m"], row["y_m"], row["z_m"])
        heading = np.array([np.cos(row["yaw_rad"]), 0.0, -np.sin(row["yaw_rad"])])
        assert step @ heading / np.linalg.norm(step) > 0.999


def test_points_on_a_car_lie_in_its_box_and_project_into_its_2d_box(
    street: StreetDrive, truth: dict[str, list[dict[str, Any]]]
) -> None:
    frame = street.frames(DRIVE)[10]
    cloud = street.read_points(frame)
    assert frame.level_projection is not None
    pixels, _ = level_project(frame.level_projection, cloud.xyz)
    filled = 0
    for rows in truth.values():
        row = next((r for r in rows if r["frame"] == 10), None)
        if row is None or row["z_m"] < 4 or row["z_m"] > 40 or row["truncated"] > 0:
            continue
        local = cloud.xyz - np.float32([row["x_m"], row["y_m"], row["z_m"]])
        local = local @ np.reshape(row["level_R_object"], (3, 3))
        size = 0.5 * np.array([row["length_m"], row["height_m"], row["width_m"]])
        inside = np.all(np.abs(local) < size - (0.0, 0.1, 0.0), axis=1)
        assert inside.sum() > 20
        u, v = pixels[inside].T
        assert row["left_px"] - 3 < u.min()
        assert u.max() < row["right_px"] + 3
        assert row["top_px"] - 3 < v.min()
        assert v.max() < row["bottom_px"] + 3
        filled += 1
    assert filled >= 3


def test_flow_follows_the_own_motion(street: StreetDrive) -> None:
    frames = street.frames(DRIVE)
    flow = street.exact_flow(frames[0], frames[1])
    assert flow.shape == (375, 1242, 2)
    assert np.isnan(flow[0, 600]).all() or np.isfinite(flow[0, 600]).all()
    # Driving forward, the road below the horizon comes nearer.
    road = flow[330, 500:700, 1]
    assert np.all(road > 3.0)


def test_the_picture_and_its_hidden_shares(
    street: StreetDrive, truth: dict[str, list[dict[str, Any]]]
) -> None:
    image = street.read_image(street.frames(DRIVE)[0])
    assert image.shape == (375, 1242, 3)
    assert 70 < image.mean() < 190
    shares = [row["occluded"] for rows in truth.values() for row in rows]
    assert min(shares) == 0.0
    assert max(shares) > 0.3


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_lidar_odometry_can_follow(speed: float) -> None:
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    drive = open_dataset(f"frames=6,images=false,speed_mps={speed}")
    config = KISSConfig()
    config.data.deskew, config.data.min_range, config.data.max_range = False, 3.5, 80.0
    config.mapping.voxel_size, config.registration.max_num_threads = 1.0, 1
    odometry, poses = KissICP(config), []
    frames = drive.frames(DRIVE)
    for frame in frames:
        xyz = drive.read_points(frame).xyz
        above = xyz[xyz[:, 1] < 1.4].astype(np.float64)
        odometry.register_frame(above, np.zeros(len(above)))
        poses.append(odometry.last_pose.copy())
    travel = inverse(poses[-1]) @ poses[0]
    error = travel @ inverse(drive.exact_egomotion(frames[0], frames[-1]))
    assert np.linalg.norm(error[:3, 3]) < 0.1
