from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kitti_tree import DRIVE, LEVEL_T_SENSOR, P2, SEQUENCE, write_raw, write_tracking

from tcrdata.datasets.kitti import open_dataset
from tcrdata.datasets.kitti_calibration import read_calibration, read_imu_mounting
from tcrdata.datasets.kitti_layout import find_sequences
from tcrdata.errors import DatasetError


def test_names_with_and_without_colon_are_known(tmp_path: Path) -> None:
    path = write_tracking(tmp_path) / "calib" / f"{SEQUENCE}.txt"
    text = path.read_text()
    renamed = text.replace("R_rect ", "R0_rect: ").replace("Tr_velo_cam ", "Tr_velo_to_cam: ")
    for content in (text, renamed.replace("Tr_imu_velo ", "Tr_imu_to_velo: ")):
        path.write_text(content)
        files = find_sequences(tmp_path)[SEQUENCE]
        calibration = read_calibration(files)
        np.testing.assert_allclose(calibration.projection, P2)
        np.testing.assert_allclose(calibration.level_T_sensor, LEVEL_T_SENSOR, atol=1e-9)
        mounting = read_imu_mounting(files)
        assert mounting is not None
        np.testing.assert_allclose(mounting[:3, 3], [-0.81, 0.32, -0.8])


def replace_line(key: str, line: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        return "\n".join(line if old.split()[0] == key else old for old in text.splitlines())

    return edit


@pytest.mark.parametrize(
    ("file", "key", "line", "message"),
    [
        ("calib_velo_to_cam.txt", "R:", "", "has no key 'R'"),
        ("calib_cam_to_cam.txt", "P_rect_02:", "", "has no key 'P_rect_02'"),
        ("calib_cam_to_cam.txt", "R_rect_00:", "R_rect_00: 1 0 0", "expected 9 numbers, found 3"),
        ("calib_velo_to_cam.txt", "T:", "T: 0 0 nan", "'T': 'nan' is not a finite number; restore"),
        ("calib_velo_to_cam.txt", "T:", "T: 0 0 zero", "'T': .*zero"),
        ("calib_velo_to_cam.txt", "R:", "R: 1 0 0 0 1 0 0 0 1.1", "'R': not a rotation"),
        ("calib_velo_to_cam.txt", "R:", "R: 1 0 0 0 1 0 0 0 -1", "'R': not a rotation"),
        ("calib_cam_to_cam.txt", "P_rect_02:", "P_rect_02:" + " 0" * 12, "must be positive"),
        ("calib_cam_to_cam.txt", "S_rect_02:", "S_rect_02: 0 375", "'S_rect_02': .*positive"),
    ],
)
def test_a_wrong_calibration_names_file_and_key(
    tmp_path: Path, file: str, key: str, line: str, message: str
) -> None:
    path = write_raw(tmp_path).parent / file
    path.write_text(replace_line(key, line)(path.read_text()))
    dataset = open_dataset(str(tmp_path))
    for ask in (dataset.info, dataset.frames):
        with pytest.raises(DatasetError, match=message) as caught:
            ask(DRIVE)
        assert file in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("file", ["calib_cam_to_cam.txt", "calib_velo_to_cam.txt"])
def test_a_missing_calibration_names_the_file(tmp_path: Path, file: str) -> None:
    (write_raw(tmp_path).parent / file).unlink()
    with pytest.raises(DatasetError, match=f"cannot read the calibration .*{file}"):
        open_dataset(str(tmp_path)).info(DRIVE)


def test_the_imu_s_place_matters_to_the_truth_alone(tmp_path: Path) -> None:
    path = write_raw(tmp_path).parent / "calib_imu_to_velo.txt"
    dataset = open_dataset(str(tmp_path))
    before = dataset.info(DRIVE)
    path.write_text("R: 1 2 3\nT: 0 0 0\n")
    assert dataset.info(DRIVE) == before
    with pytest.raises(DatasetError, match=r"calib_imu_to_velo\.txt"):
        dataset.ground_truth(DRIVE)
    path.unlink()
    assert {row["speed_mps"] for row in dataset.ground_truth(DRIVE)} == {None}
