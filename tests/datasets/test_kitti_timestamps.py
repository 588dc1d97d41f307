from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcrdata.datasets.kitti_timestamps import _longest_rising, read_timestamps
from tcrdata.errors import DatasetError


def write(folder: Path, *seconds: float | str) -> Path:
    path = folder / "velodyne_points" / "timestamps.txt"
    path.parent.mkdir(exist_ok=True)
    lines = [f"2011-09-26 13:00:{s:012.9f}" if isinstance(s, float | int) else s for s in seconds]
    path.write_text("\n".join(lines))
    return path


def wrong(path: Path, frames: range) -> list[int]:
    return [frame for frame, time in read_timestamps(path, frames).items() if time.error]


def test_times_are_utc_nanoseconds_by_frame_number(tmp_path: Path) -> None:
    times = read_timestamps(write(tmp_path, 0, 0.5, 1.123456789), range(1, 3))
    assert {frame: time.time_ns for frame, time in times.items()} == {
        1: 1317042000_500_000_000,
        2: 1317042001_123_456_789,
    }


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ((0, 1, 2, 3), []),
        ((0, 2, 1, 3), [2]),
        ((0, 1, 1, 2), [2]),
        ((0, 40, 1, 2, 3), [1]),
        ((9, 1, 2, 3), [0]),
        ((3, 2, 1), [1, 2]),
        ((0, "", 2), [1]),
        ((0, "2011-09-26", 2), [1]),
        ((0, "2011-09-26 13:00:01.1234567890", 2), [1]),
    ],
)
def test_the_fewest_lines_are_called_wrong(
    tmp_path: Path, seconds: tuple[float | str, ...], expected: list[int]
) -> None:
    assert wrong(write(tmp_path, *seconds), range(len(seconds))) == expected


def test_a_wrong_line_gets_a_time_between_its_neighbours(tmp_path: Path) -> None:
    times = read_timestamps(write(tmp_path, 10.0, "?", 10.25), range(3))
    assert times[1].time_ns - times[0].time_ns == 100_000_000
    times = read_timestamps(write(tmp_path, "?", 10.0), range(2))
    assert times[1].time_ns - times[0].time_ns == 100_000_000


def test_a_file_that_ends_early_says_where(tmp_path: Path) -> None:
    times = read_timestamps(write(tmp_path, 0, 1), range(3))
    assert times[2].error == (
        "velodyne_points/timestamps.txt, line 3: missing, the file ends at line 2"
    )


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"cannot read the timestamps .*timestamps\.txt"):
        read_timestamps(tmp_path / "timestamps.txt", range(2))


@given(st.lists(st.integers(0, 12), max_size=10))
def test_the_rising_run_is_a_longest(values: list[int]) -> None:
    chosen = _longest_rising(values)
    run = [values[i] for i in chosen]
    assert chosen == sorted(chosen)
    assert run == sorted(set(run))
    longest = [0] * len(values)
    for i, value in enumerate(values):
        longest[i] = 1 + max((longest[j] for j in range(i) if values[j] < value), default=0)
    assert len(run) == max(longest, default=0)
