"""Reads what is scored, a few sequences at a time, and cuts it into frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from tcrdata.reports import run_report
from tcrdata.types import BOX_COLUMNS, BoolArray, FloatArray

_BOX_2D = ("left_px", "top_px", "right_px", "bottom_px")


@dataclass(frozen=True)
class ScoredSequence:
    """A sequence that has labelled objects.

    Attributes:
        dataset: name of its dataset.
        sequence: the drive or clip.
        frames: frames that were built.
        known_speeds: labelled objects whose speed is known.
    """

    dataset: str
    sequence: str
    frames: int
    known_speeds: int


@dataclass(frozen=True)
class FrameObjects:
    """Labels and labelled objects of one frame.

    Attributes:
        dataset: name of the dataset.
        sequence: the drive or clip.
        scores: (N,) of the labels inside the region, falling.
        labels: (N, 7) boxes, level frame.
        labels_2d: (N, 4) pixels, NaN without a 2D box.
        truths: (M, 7) boxes.
        truths_2d: (M, 4) pixels.
        rotations: (M, 3, 3), NaN when unknown.
        sizes: (M, 3) own extents along the columns of the rotations, NaN when unknown.
        yaw_observable: (M,).
        scored: (M,) inside the region and not hidden.
        moving: (M,) known to move.
        dont_care_2d: (K, 4) pixels.
    """

    dataset: str
    sequence: str
    scores: FloatArray
    labels: FloatArray
    labels_2d: FloatArray
    truths: FloatArray
    truths_2d: FloatArray
    rotations: FloatArray
    sizes: FloatArray
    yaw_observable: BoolArray
    scored: BoolArray
    moving: BoolArray
    dont_care_2d: FloatArray


def scored_sequences(
    connection: duckdb.DuckDBPyConnection,
) -> tuple[list[ScoredSequence], list[str]]:
    """Return the sequences with labelled objects, and the names of those without."""
    rows = run_report(connection, "evaluation_sequences").fetchall()
    labelled = [ScoredSequence(d, s, frames, speeds) for d, s, frames, n, speeds in rows if n]
    return labelled, [f"{dataset}/{sequence}" for dataset, sequence, _, n, _ in rows if not n]


def read_frames(
    connection: duckdb.DuckDBPyConnection,
    sequences: Sequence[ScoredSequence],
    parameters: dict[str, Any],
    frames_a_pass: int,
) -> Iterator[FrameObjects]:
    """Yield every frame that has a label or a labelled object, in order."""
    for group in _passes(sequences, frames_a_pass):
        bounds = {
            "scored_dataset": group[0].dataset,
            "first_sequence": group[0].sequence,
            "last_sequence": group[-1].sequence,
        }
        relation = run_report(connection, "evaluation_objects", {**parameters, **bounds})
        wanted = {entry.sequence for entry in group}
        yield from _frames(relation.to_arrow_table(), wanted)


def _passes(
    sequences: Sequence[ScoredSequence], frames_a_pass: int
) -> Iterator[list[ScoredSequence]]:
    """Group neighbours of one dataset up to so many frames; at least one sequence a group."""
    group: list[ScoredSequence] = []
    for entry in sequences:
        frames = sum(member.frames for member in group) + entry.frames
        if group and (entry.dataset != group[0].dataset or frames > frames_a_pass):
            yield group
            group = []
        group.append(entry)
    if group:
        yield group


def _frames(table: Any, wanted: set[str]) -> Iterator[FrameObjects]:
    if not table.num_rows:
        return
    columns = {name: _numpy(table[name]) for name in table.column_names}
    columns["box"] = np.stack([columns[name] for name in BOX_COLUMNS], axis=1)
    columns["box_2d"] = np.stack([columns[name] for name in _BOX_2D], axis=1)
    columns["rotation"] = _lists(table["level_R_object"], 9).reshape(-1, 3, 3)
    columns["size"] = _lists(table["object_size_m"], 3)
    new = np.zeros(table.num_rows, dtype=bool)
    for name in ("dataset", "sequence", "frame"):
        new[1:] |= columns[name][1:] != columns[name][:-1]
    for start, stop in _runs(new):
        if columns["sequence"][start] in wanted:
            yield _frame({name: values[start:stop] for name, values in columns.items()})


def _runs(new: BoolArray) -> Iterator[tuple[int, int]]:
    edges = [0, *np.flatnonzero(new).tolist(), len(new)]
    return itertools.pairwise(edges)


def _numpy(column: Any) -> NDArray[Any]:
    """NULL becomes NaN in numbers and False in booleans."""
    kind = str(column.type)
    if kind == "bool":
        return np.asarray(column.fill_null(False).to_numpy(zero_copy_only=False), dtype=bool)
    return np.asarray(column.to_numpy())


def _lists(column: Any, length: int) -> FloatArray:
    """Return (N, length) numbers of a column of lists; NULL becomes NaN."""
    unknown = [np.nan] * length
    rows = [row or unknown for row in column.to_pylist()]
    return np.array(rows, dtype=np.float64).reshape(-1, length)


def _frame(columns: dict[str, NDArray[Any]]) -> FrameObjects:
    label = (columns["kind"] == "label") & columns["scored"]
    truth = columns["kind"] == "truth"
    return FrameObjects(
        dataset=str(columns["dataset"][0]),
        sequence=str(columns["sequence"][0]),
        scores=columns["score"][label],
        labels=columns["box"][label],
        labels_2d=columns["box_2d"][label],
        truths=columns["box"][truth],
        truths_2d=columns["box_2d"][truth],
        rotations=columns["rotation"][truth],
        sizes=columns["size"][truth],
        yaw_observable=columns["yaw_observable"][truth],
        scored=columns["scored"][truth],
        moving=columns["moving"][truth],
        dont_care_2d=columns["box_2d"][columns["kind"] == "dont_care"],
    )
