"""A frame's points with the motion that the cue `motion` left, as the region cues read them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcrdata.errors import FrameError, MissingEvidenceError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.motion import COSINE, MOTION_2D, MOTION_3D
from tcrdata.evidence.point_flow import nearest_pixels, projection_of
from tcrdata.evidence.point_rows import (
    EncodedPoints,
    decode_matching,
    error_rows,
    read_encoded,
)
from tcrdata.evidence.stored_flow import CycleTest, Pair, StoredFlow, image_pairs, read_flow
from tcrdata.types import CueInput, Dataset, Float32Array, FloatArray, Frame, IntArray, Rows

_CUES = (MOTION_3D, MOTION_2D, COSINE)


@dataclass(frozen=True)
class MovingPoints:
    """The points of a frame that have flow which passes a cycle test.

    M of the frame's N points.

    Attributes:
        frame: the frame.
        metric_scale: of the sequence.
        xyz: (M, 3) float32, level frame, metres.
        indices: (M,) places in the frame's own order.
        pixels: (M, 2) whole-number (column, row).
        motion_3d_m: (M,) |dXYZ|; NaN where the flow ends at no point.
        motion_2d_px: (M,) |flow - egomotion flow|.
        cosine: (M,) cosine of the two.
        heights_m: (N,) heights above the ground of all points; None when not measured.
        projection: (3, 4), level frame to homogeneous pixels.
        size_px: width and height of the image.
    """

    frame: Frame
    metric_scale: float
    xyz: Float32Array
    indices: IntArray
    pixels: IntArray
    motion_3d_m: Float32Array
    motion_2d_px: Float32Array
    cosine: Float32Array
    heights_m: Float32Array | None
    projection: FloatArray
    size_px: tuple[int, int]

    def displaced(self) -> MovingPoints:
        """Return only the points whose 3D motion is known."""
        known = np.isfinite(self.motion_3d_m)
        names = ("xyz", "indices", "pixels", "motion_3d_m", "motion_2d_px", "cosine")
        return replace(self, **{name: getattr(self, name)[known] for name in names})


@dataclass(frozen=True)
class _Item:
    frame: Frame
    flow: StoredFlow
    motion: tuple[EncodedPoints, ...]
    heights: EncodedPoints | None


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    items: tuple[_Item, ...]
    metric_scale: float
    cycle_test: CycleTest
    measure: Callable[[MovingPoints, Any], Iterator[Rows]]
    settings: Any


def each_frame(
    cue: CueInput,
    cycle_test: CycleTest,
    frames_per_task: int,
    measure: Callable[[MovingPoints, Any], Iterator[Rows]],
) -> Iterator[Rows]:
    """Yield what a region cue measures on every frame that has flow and motion.

    Args:
        cue: the sequence, with the cue's settings.
        cycle_test: flows that take part.
        frames_per_task: frames a worker takes at once.
        measure: a module-level function of the points and the cue's settings.
    """
    tasks = (
        _Task(
            cue.dataset, _items(cue, part), cue.info.metric_scale, cycle_test, measure, cue.settings
        )
        for part in chunked(image_pairs(cue.frames), frames_per_task)
    )
    for batches in cue.parallel(_measure_task, tasks):
        yield from batches


def _items(cue: CueInput, pairs: tuple[Pair, ...]) -> tuple[_Item, ...]:
    items = []
    for first, second in pairs:
        flow = read_flow(cue.tables, first, second)
        motion = [read_encoded(cue.tables, first.frame, name) for name in _CUES]
        measured = tuple(points for points in motion if points is not None)
        if flow is not None and len(measured) == len(_CUES):
            heights = read_encoded(cue.tables, first.frame, "height_m")
            items.append(_Item(first, flow, measured, heights))
    return tuple(items)


def _measure_task(task: _Task) -> list[Rows]:
    batches: list[Rows] = []
    for item in task.items:
        try:
            points = _read(task, item)
        except (FrameError, MissingEvidenceError) as error:
            batches += error_rows([(item.frame.frame, str(error))])
            continue
        batches += task.measure(points, task.settings)
    return batches


def _read(task: _Task, item: _Item) -> MovingPoints:
    cloud, projection = task.dataset.read_points(item.frame), projection_of(item.frame)
    motion_3d, motion_2d, cosine = (decode_matching(m, len(cloud)) for m in item.motion)
    points = np.flatnonzero(np.isfinite(motion_2d))
    pixels = nearest_pixels(cloud, projection, points)[0]
    passes = item.flow.passes(task.cycle_test)[pixels[:, 1], pixels[:, 0]]
    points, pixels = points[passes], pixels[passes]
    return MovingPoints(
        frame=item.frame,
        metric_scale=task.metric_scale,
        xyz=cloud.xyz[points],
        indices=points,
        pixels=pixels,
        motion_3d_m=motion_3d[points],
        motion_2d_px=motion_2d[points],
        cosine=cosine[points],
        heights_m=None if item.heights is None else decode_matching(item.heights, len(cloud)),
        projection=projection,
        size_px=(item.flow.width_px, item.flow.height_px),
    )
