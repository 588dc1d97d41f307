"""Boxes of one sequence by series: labelled objects, labels' tracks and tracklets over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.evaluation.overlap import bev_overlap
from tcrdata.types import BOX_COLUMNS, BoolArray, FloatArray, IntArray

TRUTH = "truth"


@dataclass(frozen=True)
class Series:
    """One object, track or tracklet.

    Attributes:
        name: of it.
        frames: (N,) rising.
        boxes: (N, 7), level frame.
        rotations: (N, 3, 3) of labelled objects, NaN where unknown.
        sizes: (N, 3) their own extents along these axes, NaN where unknown.
        scored: (N,) inside the region and not hidden.
        moving: (N,) known to move.
        yaw_observable: whether its yaw is scored.
        visible_px: (N,) of labelled objects, NaN where unknown.
        contained: (N,) whether another object covers it.
        found: how each box of a tracklet was found; None for others.
        object_id: labelled object that a tracklet began with; None for others.
    """

    name: str
    frames: IntArray
    boxes: FloatArray
    rotations: FloatArray
    sizes: FloatArray
    scored: BoolArray
    moving: BoolArray
    yaw_observable: bool
    visible_px: FloatArray
    contained: BoolArray
    found: tuple[str | None, ...]
    object_id: str | None

    def at(self, frame: int) -> int:
        """Return the row of a frame, -1 when it has none."""
        place = int(np.searchsorted(self.frames, frame))
        return place if place < len(self.frames) and self.frames[place] == frame else -1


@dataclass(frozen=True)
class SequenceSeries:
    """All that is scored in one sequence.

    Attributes:
        dataset: its name.
        sequence: the drive or clip.
        kinds: kind (see `tracking_objects.sql`) to its series, by name.
    """

    dataset: str
    sequence: str
    kinds: Mapping[str, tuple[Series, ...]]

    def of(self, kind: str) -> tuple[Series, ...]:
        """Return the series of a kind."""
        return self.kinds.get(kind, ())


def series_of(dataset: str, sequence: str, table: Any) -> SequenceSeries:
    """Cut the rows of `tracking_objects.sql`, sorted by kind, series and frame, into series.

    Args:
        dataset: name.
        sequence: the drive or clip.
        table: pyarrow Table.
    """
    kinds: dict[str, list[Series]] = {}
    names = list(zip(table["kind"].to_pylist(), table["series_id"].to_pylist(), strict=True))
    first = 0
    for last in range(1, len(names) + 1):
        if last == len(names) or names[last] != names[first]:
            part = table.slice(first, last - first)
            kinds.setdefault(names[first][0], []).append(_series(names[first][1], part))
            first = last
    return SequenceSeries(dataset, sequence, {kind: tuple(own) for kind, own in kinds.items()})


def _series(name: str, part: Any) -> Series:
    nan = [float("nan")] * 9
    sizes = [size or nan[:3] for size in part["object_size_m"].to_pylist()]
    return Series(
        name,
        _numbers(part, "frame").astype(np.int64),
        np.column_stack([_numbers(part, column) for column in BOX_COLUMNS]),
        np.array([m or nan for m in part["level_R_object"].to_pylist()]).reshape(-1, 3, 3),
        np.array(sizes, dtype=np.float64).reshape(-1, 3),
        np.array(part["scored"].to_pylist(), dtype=bool),
        np.array(part["moving"].to_pylist(), dtype=bool),
        bool(part["yaw_observable"][0].as_py()),
        _numbers(part, "visible_px"),
        np.array([owner is not None for owner in part["contained_in"].to_pylist()]),
        tuple(part["found"].to_pylist()),
        part["object_id"][0].as_py(),
    )


def _numbers(part: Any, column: str) -> FloatArray:
    values = part[column].to_pylist()
    return np.array([float("nan") if v is None else v for v in values], dtype=np.float64)


def overlap(own: Series, truth: Series, frame: int) -> float:
    """Return the footprints' IoU of a series and a labelled object; 0 in a frame without one."""
    i, j = own.at(frame), truth.at(frame)
    if i < 0 or j < 0:
        return 0.0
    return float(
        bev_overlap(
            own.boxes[i : i + 1], truth.boxes[j : j + 1], truth.rotations[j : j + 1],
            truth.sizes[j : j + 1],
            np.array([truth.yaw_observable]),
        )[0, 0]
    )  # fmt: skip


def rows_at(series: tuple[Series, ...], frame: int) -> list[tuple[int, int]]:
    """Return (number of the series, row) of those that have a frame."""
    return [(n, row) for n, own in enumerate(series) if (row := own.at(frame)) >= 0]


def frame_overlap(
    own: tuple[Series, ...], truths: tuple[Series, ...], frame: int
) -> tuple[list[tuple[int, int]], list[tuple[int, int]], FloatArray]:
    """Return whom a frame shows of two groups of series, and their (N, M) overlaps."""
    ours, theirs = rows_at(own, frame), rows_at(truths, frame)
    boxes = np.array([own[n].boxes[row] for n, row in ours]).reshape(-1, 7)
    true = np.array([truths[n].boxes[row] for n, row in theirs]).reshape(-1, 7)
    turned = np.array([truths[n].rotations[row] for n, row in theirs]).reshape(-1, 3, 3)
    sizes = np.array([truths[n].sizes[row] for n, row in theirs]).reshape(-1, 3)
    known = np.array([truths[n].yaw_observable for n, _ in theirs], dtype=bool)
    return ours, theirs, bev_overlap(boxes, true, turned, sizes, known)
