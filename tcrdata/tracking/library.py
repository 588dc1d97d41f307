"""The library of trajectories: how things that were seen to move, moved.

An entry is a path normalised to its start: displacements along the first motion, down, and across
it, step by step. Oriented to another object's first motion it says where that may go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import SettingsError
from tcrdata.types import Float32Array, FloatArray, IntArray

FIRST_FRAMES = 3
"""The first motion is that of so many frames."""


@dataclass(frozen=True)
class LibrarySettings:
    """How entries are cut from tracklets.

    Attributes:
        stride_frames: an entry begins every so many frames of a tracklet.
        fewest_frames: shorter paths are no entries.
        most_frames: longer ones are cut.
    """

    stride_frames: int = 5
    fewest_frames: int = 6
    most_frames: int = 40

    def __post_init__(self) -> None:
        """Refuse what makes no paths.

        Raises:
            SettingsError: a length that is too small; names it.
        """
        for name, least in (("stride_frames", 1), ("fewest_frames", 2), ("most_frames", 2)):
            if getattr(self, name) < least:
                raise SettingsError(f"track.library.{name}: at least {least}")


@dataclass(frozen=True)
class Library:
    """Entries, in metres of the world that they were seen in or are used in.

    Attributes:
        steps: (K, T, 3) displacement from the start along, down and across the first motion after
            1 to T frames; a path that ends earlier stays where it ends.
        turns: (K, T) yaw relative to the start.
        speeds: (K,) metres a frame of the first motion.
    """

    steps: Float32Array
    turns: Float32Array
    speeds: FloatArray

    def __len__(self) -> int:
        return len(self.speeds)

    def oriented(
        self, box: FloatArray, velocity: FloatArray
    ) -> tuple[Float32Array, Float32Array, FloatArray]:
        """Turn every path to an object's motion.

        Args:
            box: (7,) of the object, world.
            velocity: (3,) metres a frame; when it stands, its yaw is the direction.

        Returns:
            (K, T, 3) places; (K, T) yaws; (K,) differences of the first speed in metres a frame.
        """
        speed = float(np.hypot(velocity[0], velocity[2]))
        if speed > 1e-3:
            c, s = velocity[0] / speed, -velocity[2] / speed
        else:
            c, s = np.cos(box[6]), np.sin(box[6])
        along, down, across = np.moveaxis(self.steps, -1, 0)
        places = np.stack([c * along + s * across, down, -s * along + c * across], axis=-1)
        return (
            (places + box[:3]).astype(np.float32),
            (self.turns + np.float32(box[6])).astype(np.float32),
            np.abs(self.speeds - speed),
        )


def basic_library(frames: int, speed: float) -> Library:
    """Return the two paths that need no experience: to stay, and to go on at a speed."""
    steps = np.zeros((2, frames, 3), np.float32)
    steps[1, :, 0] = speed * np.arange(1, frames + 1)
    return Library(steps, np.zeros((2, frames), np.float32), np.array([0.0, speed]))


def joined(a: Library, b: Library) -> Library:
    """Return the entries of two libraries; the shorter ones stay where they end."""
    frames = max(a.steps.shape[1], b.steps.shape[1])
    return Library(
        np.concatenate([_padded(a.steps, frames), _padded(b.steps, frames)]),
        np.concatenate([_padded(a.turns, frames), _padded(b.turns, frames)]),
        np.concatenate([a.speeds, b.speeds]),
    )


def cut(library: Library, frames: int) -> Library:
    """Return a library's paths up to a number of steps."""
    return Library(library.steps[:, :frames], library.turns[:, :frames], library.speeds)


def library_of_rows(rows: Sequence[dict[str, Any]], metric_scale: float) -> Library:
    """Return the library of rows of `trajectories`.

    Args:
        rows: that a rule has let in.
        metric_scale: of the world they are used in; paths of another one are scaled to it.
    """
    frames = max((len(row["along_m"]) for row in rows), default=0)
    steps = np.zeros((len(rows), frames, 3), np.float32)
    turns = np.zeros((len(rows), frames), np.float32)
    speeds = np.zeros(len(rows))
    for i, row in enumerate(rows):
        scale = metric_scale / row["metric_scale"]
        path = np.array([row["along_m"], row["down_m"], row["across_m"]]).T * scale
        steps[i] = _held(path, frames)
        turns[i] = _held(np.asarray(row["turn_rad"]), frames)
        speeds[i] = row["first_step_m"] * scale
    return Library(steps, turns, speeds)


def entry_starts(frames: IntArray, settings: LibrarySettings) -> list[tuple[int, int]]:
    """Return spans (first, last + 1) of a tracklet's sightings that make entries.

    Args:
        frames: (N,) numbers of its frames, rising; a span holds no gap.
        settings: lengths.
    """
    spans = []
    for first in range(0, len(frames), settings.stride_frames):
        last = first
        while (
            last + 1 < len(frames)
            and frames[last + 1] == frames[last] + 1
            and last - first < settings.most_frames
        ):
            last += 1
        if last - first + 1 >= settings.fewest_frames:
            spans.append((first, last + 1))
    return spans


def normalised(boxes: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return a path relative to its start.

    Args:
        boxes: (N, 7) of a tracklet in the world, one a frame, N > 1.

    Returns:
        (N - 1, 3) displacements along, down and across the first motion; (N - 1,) turns in
        radians; metres a frame of the first motion.
    """
    first = boxes[min(FIRST_FRAMES, len(boxes) - 1), :3] - boxes[0, :3]
    length = float(np.hypot(first[0], first[2]))
    if length > 1e-3:
        c, s = first[0] / length, -first[2] / length
    else:
        c, s = np.cos(boxes[0, 6]), np.sin(boxes[0, 6])
    moved = boxes[1:, :3] - boxes[0, :3]
    steps = np.column_stack(
        [c * moved[:, 0] - s * moved[:, 2], moved[:, 1], s * moved[:, 0] + c * moved[:, 2]]
    )
    turns = np.unwrap(boxes[:, 6])[1:] - boxes[0, 6]
    return steps, turns, length / min(FIRST_FRAMES, len(boxes) - 1)


def _padded(values: Float32Array, frames: int) -> Float32Array:
    missing = frames - values.shape[1]
    if not missing or not len(values):
        return values if not missing else np.zeros((0, frames, *values.shape[2:]), np.float32)
    if not values.shape[1]:
        return np.zeros((len(values), frames, *values.shape[2:]), np.float32)
    return np.concatenate([values, np.repeat(values[:, -1:], missing, axis=1)], axis=1)


def _held(values: FloatArray, frames: int) -> FloatArray:
    """Return values of (n, ...) with the last one repeated up to a number of frames."""
    return np.concatenate([values, np.repeat(values[-1:], frames - len(values), axis=0)])
