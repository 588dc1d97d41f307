"""Reads, frame by frame, what tracks need of the points: clusters first, then whole boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.box_visibility import hidden_edges
from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching
from tcrdata.evidence.proposal_columns import merged, vote_columns
from tcrdata.evidence.range_images import (
    LidarCells,
    RangeGrid,
    RangeImage,
    range_image,
    sensor_grid,
)
from tcrdata.geometry.boxes import points_in_box
from tcrdata.types import (
    BoolArray,
    Dataset,
    Float32Array,
    FloatArray,
    Frame,
    ImageArray,
    IntArray,
    Sensor,
)

T = TypeVar("T")


@dataclass(frozen=True)
class ProbeSettings:
    """How boxes are looked at in a frame; metres are multiplied by the metric scale.

    Attributes:
        margin_m: a return nearer by this hides what is behind it.
        margin_share: and by this share of the range on top.
        grow_m: a box without a cluster takes the points this far outside of its sides.
        front_m: a return this much nearer hides a box's outline.
    """

    margin_m: float = 0.3
    margin_share: float = 0.008
    grow_m: float = 0.2
    front_m: float = 0.5


@dataclass(frozen=True)
class FrameTask:
    """One frame and the boxes to look at there.

    Attributes:
        frame: where to read.
        boxes: (K, 7) level frame; for clusters in the first look (0, 7).
        indices: K (first look: as many as clusters) arrays of point indices; empty for boxes
            without a cluster.
        least_points: K numbers: a box around fewer points is not looked at; first look: empty.
        evidence: encoded ground, votes_free and votes_static; what is missing counts as zero.
    """

    frame: Frame
    boxes: FloatArray
    indices: tuple[IntArray, ...]
    least_points: tuple[int, ...] = ()
    evidence: tuple[EncodedPoints, ...] = ()


@dataclass(frozen=True)
class ChunkTask:
    """Some frames of one sequence, for one worker."""

    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: ProbeSettings
    most_points: int
    frames: tuple[FrameTask, ...]


@dataclass(frozen=True)
class BoxLook:
    """What one frame shows of one box.

    Attributes:
        xyz: (N, 3) level points: of the cluster, else those in the grown box that are no ground;
            thinned to the chunk's `most_points`.
        hidden: (4,) edges whose end is hidden.
        points_inside: points in the box itself that are no ground.
        measured: occluded_share of the box, and what the free-space votes say of the points inside:
            columns of `proposals`.
    """

    xyz: Float32Array
    hidden: BoolArray
    points_inside: int
    measured: dict[str, Any]


@dataclass(frozen=True)
class FrameFailure:
    """A frame that could not be read, and why."""

    frame: int
    error: str


def gather_chunk(task: ChunkTask) -> list[list[Float32Array] | FrameFailure]:
    """Return the thinned (N, 3) level points of each cluster, frame by frame."""
    return _each_frame(task, _gather)


def look_chunk(task: ChunkTask) -> list[list[BoxLook | None] | FrameFailure]:
    """Return what each frame shows of each of its boxes; None for one around too few points."""
    return _each_frame(task, _look)


def _each_frame(
    task: ChunkTask, measure: Callable[[ChunkTask, FrameTask, Float32Array], T]
) -> list[T | FrameFailure]:
    result: list[T | FrameFailure] = []
    for item in task.frames:
        try:
            xyz = task.dataset.read_points(item.frame).xyz
        except FrameError as error:
            result.append(FrameFailure(item.frame.frame, str(error)))
        else:
            result.append(measure(task, item, xyz))
    return result


def _gather(task: ChunkTask, item: FrameTask, xyz: Float32Array) -> list[Float32Array]:
    return [xyz[thinned(chosen, task.most_points)] for chosen in item.indices]


def _look(task: ChunkTask, item: FrameTask, xyz: Float32Array) -> list[BoxLook | None]:
    grid = sensor_grid(item.frame, task.sensor, LidarCells())
    image = range_image(xyz, grid)
    evidence = _evidence(item, len(xyz))
    solid = np.flatnonzero(evidence["ground"] == 0)
    view = _View(task, xyz, image, grid, solid, xyz.take(solid, axis=0))
    shown = [
        view.show(box, chosen, least)
        for box, chosen, least in zip(item.boxes, item.indices, item.least_points, strict=True)
    ]
    inside = [shape.inside for shape in shown if shape is not None]
    boxes = item.boxes[[shape is not None for shape in shown]]
    columns = merged(
        vote_columns(inside, evidence["votes_free"], evidence["votes_static"]),
        occluded_columns(boxes, grid, image, task.settings.front_m * task.metric_scale),
    )
    measured = iter(zip(*columns.values(), strict=True))
    return [
        None
        if shape is None
        else BoxLook(
            xyz=shape.xyz,
            hidden=shape.hidden,
            points_inside=len(shape.inside),
            measured=dict(zip(columns, next(measured), strict=True)),
        )
        for shape in shown
    ]


def thinned(indices: IntArray, most: int) -> IntArray:
    """Return at most `most` of the indices, evenly spread."""
    if len(indices) <= most:
        return indices
    return indices[np.arange(most) * len(indices) // most]


def _evidence(item: FrameTask, count: int) -> dict[str, ImageArray]:
    names = ("ground", "votes_free", "votes_static")
    found = {e.cue: decode_matching(e, count).astype(np.uint8) for e in item.evidence}
    return {name: found.get(name, np.zeros(count, dtype=np.uint8)) for name in names}


@dataclass(frozen=True)
class _Shown:
    """A box's points, which of its edges are hidden, and which points lie in it."""

    xyz: Float32Array
    hidden: BoolArray
    inside: IntArray


@dataclass(frozen=True)
class _View:
    """One frame's points, and those of them that are no ground."""

    task: ChunkTask
    xyz: Float32Array
    image: RangeImage
    grid: RangeGrid
    solid: IntArray
    solid_xyz: Float32Array

    def show(self, box: FloatArray, cluster: IntArray, least_points: int) -> _Shown | None:
        """Return what is seen of one box; None around too few points."""
        settings, scale = self.task.settings, self.task.metric_scale
        grown = np.flatnonzero(points_in_box(self.solid_xyz, box, settings.grow_m * scale))
        chosen = cluster if len(cluster) else self.solid[grown]
        if len(chosen) < least_points:
            return None
        inside = self.solid[grown[points_in_box(self.solid_xyz[grown], box)]]
        xyz = self.xyz[thinned(chosen, self.task.most_points)]
        hidden = np.zeros(4, dtype=bool)
        if len(xyz):
            hidden = hidden_edges(
                xyz,
                box,
                self.image,
                self.grid,
                settings.margin_m * scale,
                settings.margin_share,
                scale,
            )
        return _Shown(xyz, hidden, inside)
