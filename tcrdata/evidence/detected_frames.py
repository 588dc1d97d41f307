"""Frames looked up for standing objects: the points of each, and what each shows of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    merged,
    outline_columns,
    point_columns,
    vote_columns,
)
from tcrdata.evidence.range_images import LidarCells, range_image, sensor_grid
from tcrdata.evidence.static_map import thin
from tcrdata.evidence.track_rows import EDGE_MARGIN_M, overlapped_shares
from tcrdata.evidence.world import World
from tcrdata.geometry.boxes import points_in_box
from tcrdata.types import Dataset, Float32Array, FloatArray, Frame, Sensor

EVIDENCE = ("ground", "height_m", "votes_free", "votes_static")


@dataclass(frozen=True)
class Lookup:
    """How frames are looked up, lengths already times the metric scale.

    Attributes:
        grow_m: points this far outside of a box are still looked at.
        base_m: lower points above the ground do not tell of the box's sides.
        voxel_m: side of the cubes that keep one point each.
        front_m: a return this much nearer hides a box's outline.
        metric_scale: of the sequence.
    """

    grow_m: float
    base_m: float
    voxel_m: float
    front_m: float
    metric_scale: float


@dataclass(frozen=True)
class Place:
    """A frame and the objects whose places it may show.

    Attributes:
        frame: to read.
        evidence: its cues, encoded.
        numbers: of the objects.
        boxes: (N, 7), level frame.
        ranks: (N,) of two objects at one place the higher one claims it.
    """

    frame: Frame
    evidence: dict[str, EncodedPoints]
    numbers: tuple[int, ...]
    boxes: FloatArray
    ranks: FloatArray


@dataclass(frozen=True)
class Chunk:
    """Frames that one worker looks up."""

    dataset: Dataset
    sensor: Sensor
    world: World
    lookup: Lookup
    places: tuple[Place, ...]


@dataclass(frozen=True)
class Shown:
    """What the frames of a chunk show.

    Attributes:
        points: number of an object and its (N, 4) points: world x, y, z, height above the ground.
        rows: frame, numbers of its objects, and their columns.
        errors: (frame, what was wrong with it).
    """

    points: list[tuple[int, Float32Array]]
    rows: list[tuple[int, tuple[int, ...], Columns]]
    errors: list[tuple[int, str]]


@dataclass(frozen=True)
class _Sweep:
    xyz: Float32Array
    evidence: dict[str, np.ndarray]


def standing_points(chunk: Chunk) -> Shown:
    """Collect the points that stand still in the objects' boxes, carried into the world."""
    shown = Shown([], [], [])
    for place in chunk.places:
        sweep = _read(chunk, place, shown.errors)
        if sweep is None:
            continue
        votes_free, votes_static = sweep.evidence["votes_free"], sweep.evidence["votes_static"]
        height = sweep.evidence["height_m"]
        stands = ~sweep.evidence["ground"] & (votes_static >= votes_free)
        chosen = np.flatnonzero(stands & (height >= chunk.lookup.base_m))
        for number, box in zip(place.numbers, place.boxes, strict=True):
            inside = chosen[points_in_box(sweep.xyz[chosen], box, chunk.lookup.grow_m)]
            moved = chunk.world.point_to_world(
                place.frame.frame, sweep.xyz[inside].astype(np.float64)
            )
            columns = np.column_stack([moved, height[inside]]).astype(np.float32)
            shown.points.append((number, thin(columns, chunk.lookup.voxel_m)))
    return shown


def object_columns(chunk: Chunk) -> Shown:
    """Measure what each frame shows of the objects at their places."""
    shown = Shown([], [], [])
    for place in chunk.places:
        sweep = _read(chunk, place, shown.errors)
        if sweep is not None:
            shown.rows.append((place.frame.frame, place.numbers, _columns(chunk, place, sweep)))
    return shown


def _read(chunk: Chunk, place: Place, errors: list[tuple[int, str]]) -> _Sweep | None:
    """Return a frame's points and evidence; None, and maybe an error, without."""
    if len(place.evidence) < len(EVIDENCE):
        return None
    try:
        xyz = chunk.dataset.read_points(place.frame).xyz
    except FrameError as error:
        errors.append((place.frame.frame, str(error)))
        return None
    rows = place.evidence.items()
    return _Sweep(xyz, {name: decode_matching(row, len(xyz)) for name, row in rows})


def _columns(chunk: Chunk, place: Place, sweep: _Sweep) -> Columns:
    evidence, scale = sweep.evidence, chunk.lookup.metric_scale
    solid = np.flatnonzero(~evidence["ground"])
    inside = [
        solid[points_in_box(sweep.xyz[solid], box, chunk.lookup.grow_m)] for box in place.boxes
    ]
    grid = sensor_grid(place.frame, chunk.sensor, LidarCells())
    image = range_image(sweep.xyz, grid)
    xz = [sweep.xyz[members][:, [0, 2]] for members in inside]
    columns = merged(
        box_columns(place.boxes, place.frame),
        point_columns(inside, evidence["height_m"]),
        vote_columns(inside, evidence["votes_free"], evidence["votes_static"]),
        outline_columns(place.boxes, xz, EDGE_MARGIN_M * scale),
        occluded_columns(place.boxes, grid, image, chunk.lookup.front_m),
        {"overlapped_share": overlapped_shares(place.boxes, place.ranks)},
    )
    # An object has rows in many frames: which points are its own follows from its box.
    columns["point_indices"] = [None] * len(place.boxes)
    return columns
