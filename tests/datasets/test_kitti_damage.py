from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kitti_tree import (
    DRIVE,
    HEIGHT_PX,
    WIDTH_PX,
    image_file,
    picture,
    sweep,
    sweep_file,
    write_raw,
)
from PIL import Image

from tcrdata.datasets.kitti import KittiDataset, open_dataset
from tcrdata.errors import DatasetError, FrameError

Raw = tuple[KittiDataset, Path]


@pytest.fixture
def raw(tmp_path: Path) -> Raw:
    folder = write_raw(tmp_path)
    return open_dataset(str(tmp_path)), folder


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data[:-5], "cut short: .* bytes"),
        (lambda data: b"", "has no points"),
    ],
)
def test_a_sweep_of_an_impossible_size_is_seen_without_reading(
    raw: Raw, damage: Callable[[bytes], bytes], message: str
) -> None:
    dataset, folder = raw
    good = dataset.frames(DRIVE)[1]
    path = sweep_file(folder, 1)
    path.write_bytes(damage(path.read_bytes()))
    frames = dataset.frames(DRIVE)
    assert [f.status for f in frames] == ["ok", "error", "ok", "ok", "ok"]
    assert frames[1].error is not None
    assert path.name in frames[1].error
    with pytest.raises(FrameError, match=message):
        dataset.read_points(good)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("column", ["x", "y", "z", "reflectance"])
def test_a_sweep_with_numbers_that_are_none_names_frame_column_and_count(
    raw: Raw, value: float, column: str
) -> None:
    dataset, folder = raw
    points = sweep(3)
    points[5:7, ["x", "y", "z", "reflectance"].index(column)] = value
    points.tofile(sweep_file(folder, 3))
    frame = dataset.frames(DRIVE)[3]
    with pytest.raises(FrameError, match=rf"frame 3: .*2 of {len(points)} points .* {column} "):
        dataset.read_points(frame)


def test_a_sweep_of_nan_alone_is_a_frame_error(raw: Raw) -> None:
    dataset, folder = raw
    np.full((10, 4), np.nan, dtype=np.float32).tofile(sweep_file(folder, 0))
    with pytest.raises(FrameError, match="10 of 10 points"):
        dataset.read_points(dataset.frames(DRIVE)[0])


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def no_png(path: Path) -> None:
    path.write_bytes(b"\xff\xd8\xff" + b"0" * 200)


def enlarge(path: Path) -> None:
    picture(0).resize((WIDTH_PX + 2, HEIGHT_PX)).save(path)


@pytest.mark.parametrize(
    ("damage", "message"),
    [(truncate, "cut short"), (no_png, "not a PNG"), (enlarge, "162x48")],
)
@pytest.mark.parametrize("frame", [0, 3])
def test_a_bad_image_leaves_the_points(
    raw: Raw, damage: Callable[[Path], None], message: str, frame: int
) -> None:
    dataset, folder = raw
    damage(image_file(folder, frame))
    frames = dataset.frames(DRIVE)
    assert {f.status for f in frames} == {"ok"}
    assert [f.frame for f in frames if not f.has_image] == [frame]
    bad = frames[frame]
    assert bad.image_error is not None
    assert message in bad.image_error
    assert image_file(folder, frame).name in bad.image_error
    assert len(dataset.read_points(bad)) > 0
    with pytest.raises(FrameError, match=message):
        dataset.read_image(bad)


def test_damage_inside_an_image_is_seen_when_it_is_read(raw: Raw) -> None:
    dataset, folder = raw
    path = image_file(folder, 1)
    data = bytearray(path.read_bytes())
    data[60:90] = bytes(30)
    path.write_bytes(data)
    with pytest.raises(FrameError, match=r"0000000001\.png cannot be decoded"):
        dataset.read_image(dataset.frames(DRIVE)[1])


def test_no_damaged_image_is_taken_for_a_whole_one(raw: Raw) -> None:
    dataset, folder = raw
    path, frame = image_file(folder, 1), dataset.frames(DRIVE)[1]
    whole, data = dataset.read_image(frame), path.read_bytes()
    for place in np.linspace(0, len(data) - 1, 40).astype(int):
        path.write_bytes(bytes([*data[:place], data[place] ^ 1, *data[place + 1 :]]))
        with pytest.raises(FrameError, match="cannot be decoded"):
            dataset.read_image(frame)
        path.write_bytes(data[:place])
        with pytest.raises(FrameError, match="cannot be decoded"):
            dataset.read_image(frame)
    path.write_bytes(data)
    assert np.array_equal(dataset.read_image(frame), whole)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P"])
def test_every_kind_of_png_is_read_as_colours(raw: Raw, mode: str) -> None:
    dataset, folder = raw
    path, frame = image_file(folder, 1), dataset.frames(DRIVE)[1]
    with Image.open(path) as image:
        kept = image.convert("RGB").convert(mode)
    kept.save(path)
    assert np.array_equal(dataset.read_image(frame), np.asarray(kept.convert("RGB")))


def rewrite_line(path: Path, line: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("sensor", ["velodyne_points", "image_02"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2011-09-26 13:02:25.000000000", "does not rise"),
        ("2011-09-26 13:0", "is not a time"),
        ("", "is not a time"),
    ],
)
def test_a_wrong_time_names_file_and_line(raw: Raw, sensor: str, text: str, message: str) -> None:
    dataset, folder = raw
    rewrite_line(folder / sensor / "timestamps.txt", 3, text)
    frames = dataset.frames(DRIVE)
    assert [f.status for f in frames] == ["ok", "ok", "error", "ok", "ok"]
    assert frames[2].error is not None
    assert f"{sensor}/timestamps.txt, line 3" in frames[2].error
    assert message in frames[2].error
    assert (np.diff([f.timestamp_ns for f in frames]) > 0).all()


def test_a_drive_without_any_clock_says_which_files_are_missing(raw: Raw) -> None:
    dataset, folder = raw
    assert "times from" not in dataset.info(DRIVE).calibration
    (folder / "velodyne_points" / "timestamps.txt").unlink()
    assert "times from 2" in dataset.info(DRIVE).calibration
    assert {f.status for f in dataset.frames(DRIVE)} == {"ok"}
    (folder / "image_02" / "timestamps.txt").unlink()
    with pytest.raises(DatasetError, match=r"no timestamps: .*velodyne_points/timestamps\.txt"):
        dataset.frames(DRIVE)
