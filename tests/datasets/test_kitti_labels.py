from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from kitti_tree import LEVEL_T_SENSOR, label_lines, tracklets

from tcrdata.datasets.kitti_labels import read_label_file, read_tracklets
from tcrdata.errors import DatasetError

VAN = "0 7 Van 1 2 -1.8 10 20 30 40 2.0 1.8 4.4 -4.5 1.9 13.4 -2.1"


def test_a_label_line_becomes_a_box_with_its_geometric_centre(tmp_path: Path) -> None:
    path = tmp_path / "0000.txt"
    path.write_text(VAN + "\n\n")
    (label,) = read_label_file(path)
    assert (label.frame, label.object_id, label.category) == (0, "7", "Van")
    assert (label.truncated, label.occluded) == (1.0, 2.0)
    assert label.box == pytest.approx((-4.5, 0.9, 13.4, 4.4, 1.8, 2.0, -2.1))
    assert label.image_box_px == (10, 20, 30, 40)


def test_regions_left_out_of_scoring_have_no_box(tmp_path: Path) -> None:
    path = tmp_path / "0000.txt"
    path.write_text("\n".join(label_lines(0)))
    region = read_label_file(path)[0]
    assert (region.category, region.box, region.image_box_px) == ("DontCare", None, (3, 4, 9, 11))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (VAN.rsplit(" ", 1)[0], "found 16 fields"),
        (VAN + " 0.5", "found 18 fields"),
        (VAN.replace("13.4", "far"), "far"),
        (VAN.replace("13.4", "nan"), "'nan' is not a finite number"),
        (VAN.replace("0 7", "0.5 7"), "0.5"),
        (VAN.replace("0 7", "-1 7"), "the frame is negative"),
        (VAN.replace("4.4", "0"), "must be positive"),
    ],
)
def test_a_broken_line_names_file_line_and_what_was_expected(
    tmp_path: Path, line: str, message: str
) -> None:
    path = tmp_path / "0000.txt"
    path.write_text(f"{VAN}\n{line}\n")
    with pytest.raises(DatasetError, match=r"0000\.txt', line 2: ") as caught:
        read_label_file(path)
    assert message in str(caught.value)
    assert "expected 17 fields: frame track_id type" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_a_file_there_are_no_labels(tmp_path: Path) -> None:
    assert read_label_file(tmp_path / "none.txt") == []
    assert read_tracklets(tmp_path / "none.xml", LEVEL_T_SENSOR) == []


def write_tracklets(folder: Path, *changes: tuple[str, str]) -> Path:
    text = tracklets(first_frame=3, frames=2)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "tracklet_labels.xml"
    path.write_text(text)
    return path


def test_tracklets_stand_upright_in_the_level_frame(tmp_path: Path) -> None:
    labels = read_tracklets(write_tracklets(tmp_path), LEVEL_T_SENSOR)
    assert [(label.frame, label.object_id) for label in labels] == [
        (3, "0"),
        (4, "0"),
        (3, "1"),
        (4, "1"),
    ]
    assert labels[2].category == "Car"
    # 22 - 0.5 * 3 m ahead, 3.5 m to the right, the bottom on the ground 1.73 m below the LiDAR.
    expected = (3.5, 1.73 - 0.75 - 0.08, 20.5 - 0.27, 3.9, 1.6, 1.5, -0.1 - math.pi / 2)
    assert labels[2].box == pytest.approx(expected)
    assert labels[2].image_box_px is None


def test_codes_of_tracklets_become_those_of_labels(tmp_path: Path) -> None:
    path = write_tracklets(
        tmp_path,
        ("<occlusion>0", "<occlusion>-1"),
        ("<truncation>0", "<truncation>99"),
        ("Van", "Person (sitting)"),
    )
    first, second, *_ = read_tracklets(path, LEVEL_T_SENSOR)
    assert (first.category, first.occluded, first.truncated) == ("Person", 3.0, None)
    assert (second.occluded, second.truncated) == (0.0, 0.0)


def test_poses_out_of_the_image_or_behind_the_camera_are_left_out(tmp_path: Path) -> None:
    path = write_tracklets(tmp_path, ("<truncation>0", "<truncation>2"), ("<tx>20.5", "<tx>-20.5"))
    labels = read_tracklets(path, LEVEL_T_SENSOR)
    assert [(label.frame, label.object_id) for label in labels] == [(4, "0"), (4, "1")]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</tracklets>", "", "not well-formed XML: .* line"),
        ("<tz>", "<up>", "not well-formed XML"),
        ("<rz>0.0</rz>", "", "tracklet 0, pose 0: no <rz>"),
        ("<rz>0.0</rz>", "<rz>inf</rz>", "pose 0, <rz>: 'inf' is not a finite number"),
        ("<rz>0.1</rz>", "<rz>left</rz>", "tracklet 1, pose 0, <rz>: .*left"),
        ("<h>2.0", "<h>-2.0", "tracklet 0, <h>: -2 is not positive"),
        ("<!DOCTYPE boost_serialization>", '<!DOCTYPE b [<!ENTITY a "b">]>', "entities"),
    ],
)
def test_broken_tracklets_say_where(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = write_tracklets(tmp_path, (old, new))
    with pytest.raises(DatasetError, match=message) as caught:
        read_tracklets(path, LEVEL_T_SENSOR)
    assert "tracklet_labels.xml" in str(caught.value)


def test_yaw_follows_a_turned_mounting(tmp_path: Path) -> None:
    c, s = math.cos(0.2), math.sin(0.2)
    turn = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    path = write_tracklets(tmp_path)
    straight, turned = (
        read_tracklets(path, level_T_sensor)[0].box
        for level_T_sensor in (LEVEL_T_SENSOR, turn @ LEVEL_T_SENSOR)
    )
    assert straight is not None
    assert turned is not None
    assert turned[6] == pytest.approx(straight[6] + 0.2)
    assert turned[:3] == pytest.approx(tuple(turn[:3, :3] @ straight[:3]))
