from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tcrdata.datasets.oxts import read_poses
from tcrdata.errors import DatasetError

METRES_A_DEGREE = 6_378_137.0 * math.pi / 180


def write(folder: Path, *poses: tuple[float, ...]) -> Path:
    path = folder / "0000.txt"
    path.write_text("\n".join(" ".join(map(repr, (*pose, 0.0, 0.0))) for pose in poses) + "\n")
    return path


def test_positions_are_metres_east_north_up_of_the_first_packet(tmp_path: Path) -> None:
    step = 10.0 / METRES_A_DEGREE
    east = step / math.cos(math.radians(49.0))
    poses = read_poses(
        write(
            tmp_path,
            (49, 8, 100, 0, 0, 0),
            (49, 8 + east, 100, 0, 0, 0),
            (49 + step, 8, 101, 0, 0, 0),
        )
    )
    np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(poses[1][:3, 3], [10.0, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(poses[2][:3, 3], [0.0, 10.0, 1.0], atol=1e-4)


def test_rotations_turn_roll_then_pitch_then_yaw(tmp_path: Path) -> None:
    half = math.pi / 2
    rows = [(49, 8, 0, half, 0, 0), (49, 8, 0, 0, half, 0), (49, 8, 0, 0, 0, half)]
    rows.append((49, 8, 0, half, 0, half))
    roll, pitch, yaw, both = (pose[:3, :3] for pose in read_poses(write(tmp_path, *rows)).values())
    np.testing.assert_allclose(roll @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(pitch @ [1, 0, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(yaw @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(both, yaw @ roll, atol=1e-12)


def test_a_folder_is_read_by_frame_number(tmp_path: Path) -> None:
    for number in (100, 102):
        (tmp_path / f"{number:010d}.txt").write_text("49 8 0 0 0 0")
    assert list(read_poses(tmp_path)) == [100, 102]


def test_without_packets_there_are_no_poses(tmp_path: Path) -> None:
    assert read_poses(tmp_path / "none") == {}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("49 8 0 0 0", "expected finite lat lon alt"),
        ("49 8 nan 0 0 0", "expected finite"),
        ("49 8 x 0 0 0", "x"),
        ("90 8 0 0 0 0", "latitude 90"),
        ("", "expected finite"),
    ],
)
def test_a_broken_packet_names_file_and_line(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "0000.txt"
    path.write_text(f"49 8 0 0 0 0\n{line}\n49 8 0 0 0 0\n")
    with pytest.raises(DatasetError, match=r"0000\.txt', line 2: ") as caught:
        read_poses(path)
    assert message in str(caught.value)
    assert "restore the packet" in str(caught.value)
