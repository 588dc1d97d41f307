"""Reads frames for the first time: how many points each has, and which cannot be read."""

from __future__ import annotations

from dataclasses import replace

from tcrdata.errors import FrameError
from tcrdata.types import Dataset, Frame


def counted_frames(task: tuple[Dataset, tuple[Frame, ...]]) -> list[tuple[Frame, int | None]]:
    """Return each frame with its number of points; unreadable ones with status `error`."""
    dataset, frames = task
    counted: list[tuple[Frame, int | None]] = []
    for frame in frames:
        count: int | None = None
        if frame.status == "ok":
            try:
                count = len(dataset.read_points(frame))
            except FrameError as error:
                frame = replace(
                    frame, status="error", error=str(error).removeprefix(f"frame {frame.frame}: ")
                )
        counted.append((frame, count))
    return counted
