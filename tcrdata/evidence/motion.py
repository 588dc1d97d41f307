"""Stabilised motion of points: what is left when the egomotion is taken out.

3D: `dXYZ = point flow - egomotion flow`, 0 on the static world; its length is kept. 2D: the flow
less the flow that the egomotion gives, its length in pixels, and the cosine between the two.
One number a point, NaN where there is none: hidden behind a nearer point of its pixel, outside
the image, or (3D) without a point where its flow ends. Nothing is gated: neither by the
egomotion's cycle error nor by the flow's cycle test, which readers apply to `flows.consistent`.

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), section 3.7, and its released code.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.point_flow import (
    PixelIndex,
    ends,
    moved,
    pixel_index,
    projection_of,
    rigid_flow,
)
from tcrdata.evidence.point_rows import EncodedPoints, encoded, error_rows, point_rows
from tcrdata.evidence.stored_flow import Pair, StoredFlow, image_pairs, read_flow
from tcrdata.types import CueInput, Dataset, Float32Array, FloatArray, IntArray, Rows

NEEDS: tuple[str, ...] = ("flow", "flow_ransac")
GIVES: tuple[str, ...] = ("point_evidence",)
NEEDS_IMAGES: bool = True
MOTION_3D, MOTION_2D, COSINE = "motion_3d_m", "motion_2d_px", "motion_cosine"


@dataclass(frozen=True)
class Settings:
    """Which egomotion is taken out. Metres are multiplied by the sequence's metric scale.

    Attributes:
        egomotion: the estimator, as `egomotions.method` names it; `odometry` must have been built.
        near_m: points at a depth of at most this have no motion.
        pairs_per_task: frame pairs a worker takes at once.
    """

    egomotion: Literal["flow_ransac", "odometry"] = "flow_ransac"
    near_m: float = 1.0
    pairs_per_task: int = 8


@dataclass(frozen=True)
class _Item:
    pair: Pair
    flow: StoredFlow
    to_T_from: FloatArray


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    items: tuple[_Item, ...]
    near_m: float


@dataclass(frozen=True)
class Motion:
    """Stabilised motion of the points that have flow.

    Attributes:
        motion_3d_m: (M,) length of dXYZ; NaN where the flow ends at no point.
        motion_2d_px: (M,) length of flow - egomotion flow.
        cosine: (M,) cosine of flow and egomotion flow; 0 where one of them is 0.
    """

    motion_3d_m: FloatArray
    motion_2d_px: FloatArray
    cosine: FloatArray


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `point_evidence`: three rows for each frame that has flow and egomotion to the next."""
    settings: Settings = cue.settings
    motions = _egomotions(cue, settings.egomotion)
    near_m = settings.near_m * cue.info.metric_scale
    tasks = (
        _Task(cue.dataset, _items(cue, part, motions), near_m)
        for part in chunked(image_pairs(cue.frames), settings.pairs_per_task)
    )
    for points, errors in cue.parallel(_measure_task, tasks):
        if points:
            yield point_rows(points)
        yield from error_rows(errors)


def stabilised(
    start: PixelIndex,
    found: IntArray,
    end: PixelIndex,
    flow: Float32Array,
    ego_flow: FloatArray,
    to_T_from: FloatArray,
) -> Motion:
    """Take the egomotion out of the flow of a frame's points.

    Args:
        start: the M points of the frame that have a pixel.
        found: (M,) the next frame's points at which their flow ends, or -1.
        end: points of the next frame.
        flow: (H, W, 2) px.
        ego_flow: (M, 2) px, what the egomotion alone would give.
        to_T_from: (4, 4), this frame to the next.
    """
    carried = moved(start.xyz[start.points], to_T_from)
    apart = np.linalg.norm(end.xyz[found] - carried, axis=1)
    measured = flow[start.rows, start.columns].astype(np.float64)
    lengths = np.hypot(*measured.T) * np.hypot(*ego_flow.T)
    dot = (measured * ego_flow).sum(axis=1)
    # A flow of no length points nowhere: the cosine is 0, as in the released code.
    cosine = np.where(lengths > 0, dot / np.where(lengths > 0, lengths, 1.0), 0.0)
    cosine[np.isnan(lengths)] = np.nan
    return Motion(np.where(found >= 0, apart, np.nan), np.hypot(*(measured - ego_flow).T), cosine)


def _egomotions(cue: CueInput, method: str) -> dict[tuple[int, int], FloatArray]:
    columns = ["frame", "frame_to", "to_T_from"]
    rows = cue.tables.read("egomotions", columns=columns, method=method).to_pylist()
    return {
        (row["frame"], row["frame_to"]): np.array(row["to_T_from"]).reshape(4, 4)
        for row in rows
        if row["to_T_from"] is not None
    }


def _items(
    cue: CueInput, pairs: tuple[Pair, ...], motions: dict[tuple[int, int], FloatArray]
) -> tuple[_Item, ...]:
    found = []
    for pair in pairs:
        motion = motions.get((pair.first.frame, pair.second.frame))
        flow = read_flow(cue.tables, pair.first, pair.second)
        if motion is not None and flow is not None:
            found.append(_Item(pair, flow, motion))
    return tuple(found)


def _measure_task(task: _Task) -> tuple[list[EncodedPoints], list[tuple[int, str]]]:
    points: list[EncodedPoints] = []
    errors: list[tuple[int, str]] = []
    known: dict[int, PixelIndex] = {}
    for item in task.items:
        size = (item.flow.width_px, item.flow.height_px)
        try:
            start, end = (
                known.get(frame.frame) or pixel_index(task.dataset, frame, *size, task.near_m)
                for frame in item.pair
            )
        except FrameError as error:
            errors.append((item.pair.first.frame, str(error)))
            continue
        known = {item.pair.second.frame: end}
        points += _measure(item, start, end)
    return points, errors


def _measure(item: _Item, start: PixelIndex, end: PixelIndex) -> list[EncodedPoints]:
    first, second = item.pair
    flow = item.flow.decode()
    ego_flow = rigid_flow(
        start.xyz[start.points], item.to_T_from, projection_of(first), projection_of(second)
    )
    motion = stabilised(start, ends(start, end, flow), end, flow, ego_flow, item.to_T_from)
    values = (
        (MOTION_3D, motion.motion_3d_m),
        (MOTION_2D, motion.motion_2d_px),
        (COSINE, motion.cosine),
    )
    return [encoded(first.frame, cue, "f16", _spread(start, number)) for cue, number in values]


def _spread(start: PixelIndex, values: FloatArray) -> Float32Array:
    """Return one number for each point of the cloud, NaN where there is none."""
    spread = np.full(len(start.xyz), np.nan, np.float32)
    spread[start.points] = values
    return spread
