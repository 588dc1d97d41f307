"""A frame that cannot be used becomes a row and the rest is built; a drive fails alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_runs import build_command, done, run, status_of
from kitti_tree import (
    DRIVE,
    HEIGHT_PX,
    SEQUENCE,
    WIDTH_PX,
    image_file,
    picture,
    sweep,
    sweep_file,
    write_raw,
    write_tracking,
)

from tcrdata.store import open_store

FRAMES = 5


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    return folder


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def not_a_number(path: Path) -> None:
    points = sweep(2)
    points[3, 0] = np.nan
    points.tofile(path)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def enlarge(path: Path) -> None:
    picture(2).resize((WIDTH_PX + 2, HEIGHT_PX)).save(path)


def stop_the_clock(path: Path) -> None:
    lines = path.read_text().splitlines()
    lines[2] = lines[0]
    path.write_text("\n".join(lines) + "\n")


def clock(folder: Path, _: int) -> Path:
    return folder / "velodyne_points" / "timestamps.txt"


@pytest.mark.parametrize(
    ("file", "damage", "status", "message"),
    [
        (sweep_file, cut, "error", "sweep 0000000002.bin is cut short"),
        (sweep_file, not_a_number, "error", "0000000002.bin"),
        (sweep_file, empty, "error", "sweep 0000000002.bin has no points; fetch it again"),
        (sweep_file, Path.unlink, "error", "no sweep; fetch its .bin again"),
        (image_file, Path.unlink, "ok", "no image; fetch its .png again"),
        (image_file, cut, "ok", "image 0000000002.png is cut short"),
        (image_file, enlarge, "ok", "162x48"),
        (clock, stop_the_clock, "error", "timestamps.txt, line 3: the time does not rise"),
    ],
)
def test_a_frame_that_cannot_be_used_is_a_row_and_the_rest_is_built(
    tmp_path: Path,
    file: Callable[[Path, int], Path],
    damage: Callable[[Path], None],
    status: str,
    message: str,
) -> None:
    folder = write_raw(tmp_path / "kitti", frames=FRAMES)
    damage(file(folder, 2))
    store = tmp_path / "store"
    preset = "paper" if file is image_file else "tcrdata"
    result = done(*build_command(tmp_path / "kitti", store, "--preset", preset))
    (line,) = [line for line in result.err.splitlines() if line.startswith("left out: ")]
    assert line.startswith(f"left out: kitti/{DRIVE} frames, frame 2: ")
    assert message in line
    (problem,) = status_of(store)["problems"]
    assert (problem["where"], problem["frame"]) == (f"kitti/{DRIVE} frames", 2)
    assert message in problem["error"]
    assert "2" in done("status", "--store", store).out.partition("problems")[2]
    query = "select frame, status, coalesce(error, image_error) as what from frames order by 1"
    rows = done("sql", query, "--store", store, "--json").json
    assert [row["status"] for row in rows] == ["ok", "ok", status, "ok", "ok"]
    assert [row["frame"] for row in rows if row["what"]] == [2]
    measured = open_store(str(store)).read("egomotions").to_pylist()
    assert {row[name] for row in measured for name in ("frame", "frame_to")} >= {0, 1, 3, 4}


def test_a_drive_without_a_usable_frame_fails_however_often_it_is_built(tmp_path: Path) -> None:
    folder = write_raw(tmp_path / "kitti", frames=FRAMES)
    for frame in range(FRAMES):
        empty(sweep_file(folder, frame))
    for _ in range(2):
        result = run(*build_command(tmp_path / "kitti", tmp_path / "store"))
        assert result.code == 1
        assert f"kitti/{DRIVE}: none of its frames can be used" in result.err


def test_a_gap_in_the_frames_is_said_in_one_line_and_has_rows(tmp_path: Path) -> None:
    folder = write_raw(tmp_path / "kitti", frames=FRAMES + 1)
    for frame in (2, 3):
        sweep_file(folder, frame).unlink()
        image_file(folder, frame).unlink()
    result = done(*build_command(tmp_path / "kitti", tmp_path / "store"))
    wrong = "neither sweep nor image; fetch its .bin and .png again"
    lines = [line for line in result.err.splitlines() if line.startswith("left out: ")]
    assert lines == [f"left out: kitti/{DRIVE} frames, frames 2-3: {wrong}"]
    query = "select frame, error from frames order by frame"
    rows = done("sql", query, "--store", tmp_path / "store", "--json").json
    assert [row["error"] for row in rows] == [None, None, wrong, wrong, None, None]
    found = status_of(tmp_path / "store")["problems"]
    assert [(problem["frame"], problem["error"]) for problem in found] == [(2, wrong), (3, wrong)]
    table = done("status", "--store", tmp_path / "store").out.partition("problems")[2]
    assert "2-3" in table


def test_a_drive_without_images_builds_and_draws(tmp_path: Path) -> None:
    write_raw(tmp_path / "kitti", frames=FRAMES, images=False)
    store = tmp_path / "store"
    result = done(*build_command(tmp_path / "kitti", store, "--preset", "all"))
    assert "why 'paper' has no label: tcrdata funnel --selection " in result.err
    assert "no frame has an image: what needs one abstains" in result.err
    assert "left out" not in result.err
    assert "failed:" not in result.err
    assert status_of(store)["problems"] == []
    options = ("--frames", "1", "--selection", "tcrdata")
    assert done("draw", "--store", store, "--out", tmp_path / "out", *options).out
    done("evaluate", "--store", store)


def failures(text: str) -> list[str]:
    assert "Traceback" not in text
    return [line for line in text.splitlines() if line.startswith("failed: ")]


def test_missing_calibration_fails_the_drive_until_it_is_back(intact: Path, tmp_path: Path) -> None:
    write_raw(tmp_path / "kitti", frames=FRAMES)
    calibration = next((tmp_path / "kitti").rglob("calib_velo_to_cam.txt"))
    text = calibration.read_text()
    calibration.unlink()
    command = build_command(tmp_path / "kitti", tmp_path / "store")
    result = run(*command)
    assert result.code == 1
    found = failures(result.err)
    assert f"failed: kitti/{DRIVE} frames: cannot read the calibration" in found[0]
    assert "calib_velo_to_cam.txt" in found[0]
    assert found[0].endswith("restore it")
    status = status_of(tmp_path / "store")
    assert status["units"]["failed"] == len(found) == len(status["problems"])
    assert status["units"]["missing"] > 0
    assert failures(run(*command, "--dry-run").err)[0] == found[0]
    calibration.write_text(text)
    done(*command)
    status = status_of(tmp_path / "store")
    assert (status["units"]["failed"], status["units"]["missing"]) == (0, 0)
    assert status["problems"] == []


def test_a_label_file_with_a_broken_line_costs_the_truth_alone(tmp_path: Path) -> None:
    labels = write_tracking(tmp_path / "kitti", frames=FRAMES) / "label_02" / f"{SEQUENCE}.txt"
    good = labels.read_text()
    lines = good.splitlines()
    lines[4] = lines[4].rpartition(" ")[0]
    labels.write_text("\n".join(lines) + "\n")
    command = build_command(tmp_path / "kitti", tmp_path / "store")
    result = run(*command)
    assert result.code == 1
    (line,) = failures(result.err)
    assert f"{SEQUENCE}.txt', line 5: found 16 fields; expected 17 fields" in line
    assert "selection " in result.out
    (problem,) = status_of(tmp_path / "store")["problems"]
    assert problem["where"] == f"kitti/{SEQUENCE} ground_truth"
    foreseen = done(*command, "--dry-run", "--json").json
    assert [unit["stage"] for unit in foreseen["units"] if unit["state"] == "todo"] == [
        "ground_truth"
    ]
    labels.write_text(good)
    again = done(*command, "--json").json
    assert (again["made"], again["failed"]) == (1, 0)


def test_frames_that_are_not_there_select_nothing(intact: Path, tmp_path: Path) -> None:
    result = run(*build_command(intact, tmp_path / "store", "--frames", "100-200", "--json"))
    assert result.code == 1
    assert "no frame among --frames 100-200" in failures(result.err)[0]
    assert result.json["selections"] == []
