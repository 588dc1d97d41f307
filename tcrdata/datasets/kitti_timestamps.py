"""Timestamps of KITTI's frames, and which of their lines cannot be true."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tcrdata.datasets.kitti_layout import SequenceFiles
from tcrdata.errors import DatasetError

FRAME_PERIOD_NS = 100_000_000
_NS_IN_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Timestamp:
    """When a frame was taken.

    Attributes:
        time_ns: UTC; where `error` is set, 0.1 s a frame from the nearest good time before.
        error: what is wrong with it, in one line; None when nothing is.
    """

    time_ns: int
    error: str | None = None


def sequence_timestamps(files: SequenceFiles, frames: Sequence[int]) -> dict[int, Timestamp]:
    """Return the time of each frame.

    A raw drive has a clock a sensor: the time is the sweep's (the image's where the sweeps have
    none), and a frame is as good as the worst of its clocks. The tracking benchmark gives no
    times: 0.1 s a frame.

    Args:
        files: the sequence.
        frames: numbers of the frames, rising.

    Raises:
        DatasetError: a raw drive has no file of times, or it cannot be read.
    """
    if not files.timestamps:
        return {frame: Timestamp(frame * FRAME_PERIOD_NS) for frame in frames}
    clocks = [read_timestamps(path, frames) for path in files.timestamps if path.is_file()]
    if not clocks:
        raise DatasetError(
            f"'{files.name}' has no timestamps: restore {' or '.join(map(str, files.timestamps))}"
        )
    return {
        frame: Timestamp(
            time.time_ns, next((c[frame].error for c in clocks if c[frame].error), None)
        )
        for frame, time in clocks[0].items()
    }


def read_timestamps(path: Path, frames: Sequence[int]) -> dict[int, Timestamp]:
    """Read the line of each frame: line `frame + 1`, as the file lists the whole drive.

    Of lines that do not rise, the fewest are called wrong.

    Args:
        path: `timestamps.txt`, lines such as `2011-09-26 13:04:32.345808896`.
        frames: numbers of the frames, rising.

    Raises:
        DatasetError: the file cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as failure:
        raise DatasetError(
            f"cannot read the timestamps '{path}': {failure.strerror}; restore the file"
        ) from failure
    times = {frame: _parse(lines[frame]) if frame < len(lines) else None for frame in frames}
    read = [(frame, time) for frame, time in times.items() if time is not None]
    rising = dict(read[i] for i in _longest_rising([time for _, time in read]))
    result: dict[int, Timestamp] = {}
    anchor = next(iter(rising), 0)
    for frame in frames:
        anchor = frame if frame in rising else anchor
        time_ns = rising.get(anchor, 0) + (frame - anchor) * FRAME_PERIOD_NS
        error = None if frame in rising else _error(path, lines, frame, times[frame])
        result[frame] = Timestamp(time_ns, error)
    return result


def _error(path: Path, lines: Sequence[str], frame: int, time: int | None) -> str:
    place = f"{path.parent.name}/{path.name}, line {frame + 1}"
    if frame >= len(lines):
        return f"{place}: missing, the file ends at line {len(lines)}"
    if time is None:
        return f"{place}: '{lines[frame][:40]}' is not a time such as 2011-09-26 13:04:32.345808896"
    return f"{place}: the time does not rise; restore the file"


def _parse(line: str) -> int | None:
    seconds, _, fraction = line.strip().partition(".")
    if fraction and not (fraction.isdecimal() and len(fraction) <= 9):
        return None
    try:
        moment = datetime.strptime(seconds, "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    return int(moment.timestamp()) * _NS_IN_SECOND + int(fraction.ljust(9, "0"))


def _longest_rising(values: Sequence[int]) -> list[int]:
    """Return the indices of a longest strictly rising subsequence, the earliest of several."""
    lengths = [0] * len(values)
    tails: list[int] = []  # -(largest first value) of the rising runs found so far, by length
    for i in range(len(values) - 1, -1, -1):
        k = bisect_left(tails, -values[i])
        tails[k : k + 1] = [-values[i]]
        lengths[i] = k + 1
    chosen: list[int] = []
    for i, value in enumerate(values):
        if lengths[i] == len(tails) - len(chosen) and (not chosen or value > values[chosen[-1]]):
            chosen.append(i)
    return chosen
