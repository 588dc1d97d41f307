"""Ranges of frames: which a command is about, `0-49,60,70-`, and which share a message."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tcrdata.errors import SettingsError


@dataclass(frozen=True)
class FrameRanges:
    """A union of closed ranges of frame numbers; no range means every frame.

    Attributes:
        text: the canonical form, `all` or such as `0-49,60`.
        ranges: (first, last) pairs; last is None for an open end.
    """

    text: str = "all"
    ranges: tuple[tuple[int, int | None], ...] = ()

    def __contains__(self, frame: int) -> bool:
        if not self.ranges:
            return True
        return any(a <= frame and (b is None or frame <= b) for a, b in self.ranges)


def parse_frame_ranges(text: str | None) -> FrameRanges:
    """Return the ranges that a text such as `0-49,60,70-` names; None or `all` names every frame.

    Raises:
        SettingsError: the text is none.
    """
    if text is None or text.strip().lower() in ("", "all"):
        return FrameRanges()
    ranges = tuple(_parsed_range(part.strip(), text) for part in text.split(","))
    canonical = ",".join(str(a) if a == b else f"{a}-{'' if b is None else b}" for a, b in ranges)
    return FrameRanges(canonical, ranges)


def _parsed_range(part: str, text: str) -> tuple[int, int | None]:
    first, dash, last = part.partition("-")
    if first.isdigit() and (not dash or not last or last.isdigit()):
        start = int(first)
        end = (int(last) if last else None) if dash else start
        if end is None or end >= start:
            return start, end
    raise SettingsError(
        f"--frames '{text}': '{part}' is no range; write such as 0-49 or 0-9,20,30-"
    )


def spans(frame_errors: Iterable[tuple[int, str]]) -> list[tuple[str, str]]:
    """Return frames next to each other that share a message as one: `3` or `5-9`, and the message.

    Args:
        frame_errors: (frame, message), rising.
    """
    runs: list[tuple[int, int, str]] = []
    for frame, message in frame_errors:
        if runs and runs[-1][1:] == (frame - 1, message):
            runs[-1] = (runs[-1][0], frame, message)
        else:
            runs.append((frame, frame, message))
    return [
        (str(first) if first == last else f"{first}-{last}", message)
        for first, last, message in runs
    ]
