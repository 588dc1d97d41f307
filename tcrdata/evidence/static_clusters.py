"""Objects that stand still: clusters of many sweeps laid over one another in the world.

Windows of frames, each with a margin before and after, are mapped: every third sweep's points that
other sweeps saw too, thinned to voxels, clustered and boxed. Each object becomes a row in every
frame of its window that shows points of it. Neighbouring windows share an object's track_id where
its boxes overlap. Which objects look like vehicles is for rules to say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import even_spans
from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.point_rows import (
    EncodedPoints,
    decode_matching,
    error_rows,
    read_encoded,
)
from tcrdata.evidence.poses import read_poses
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    key_columns,
    merged,
    point_columns,
    vote_columns,
)
from tcrdata.evidence.range_images import LidarCells, range_image, sensor_grid
from tcrdata.evidence.static_map import (
    MapSettings,
    StaticObject,
    map_points,
    static_objects,
    thin,
)
from tcrdata.evidence.track_rows import EDGE_MARGIN_M
from tcrdata.evidence.world import World, make_world
from tcrdata.geometry.boxes import bev_iou, points_in_box
from tcrdata.types import CueInput, Dataset, Float32Array, FloatArray, Frame, IntArray, Rows, Sensor

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False

_EVIDENCE = ("ground", "height_m", "votes_free", "votes_static")


@dataclass(frozen=True)
class Settings:
    """How static objects are found; metres are multiplied by the sequence's metric scale.

    Attributes:
        map: how a window is cut into objects.
        window_frames: most frames a window gives rows for.
        margin_frames: frames mapped before and after.
        every_frames: every so manieth frame is mapped.
        least_points: an object with fewer points in a frame is no row; every rule asks for more.
        same_iou: objects of neighbouring windows that overlap this much are one.
        front_m: a return this much nearer hides a box's outline.
        grow_m: points this far outside of a box's sides are still its own.
    """

    map: MapSettings = field(default_factory=MapSettings)
    window_frames: int = 50
    margin_frames: int = 25
    every_frames: int = 3
    least_points: int = 5
    same_iou: float = 0.3
    front_m: float = 0.5
    grow_m: float = 0.1


@dataclass(frozen=True)
class _Window:
    """Frames `first` to `last - 1` give rows; those around them are only mapped."""

    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: Settings
    world: World
    frames: tuple[Frame, ...]
    evidence: dict[int, dict[str, EncodedPoints]]
    first: int
    last: int


@dataclass(frozen=True)
class _Found:
    """What a window gives: its objects, and for each frame the rows of some of them."""

    objects: list[StaticObject]
    frames: list[tuple[int, list[int], Columns]]
    errors: list[tuple[int, str]]


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source static and their `confidences`, frame by frame."""
    world = make_world(cue.frames, read_poses(cue.tables))
    names = _Names()
    for found in cue.parallel(_measure_window, _windows(cue, world)):
        numbers = names.number(found.objects, cue.settings.same_iou)
        ages = _ages(found)
        for frame, members, columns in found.frames:
            rows = merged(
                columns,
                key_columns(
                    world.frames[frame],
                    "static",
                    "l_shape",
                    [numbers[m] for m in members],
                    cue.info.metric_scale,
                ),
                _object_columns(cue, found.objects, members, numbers),
                {name: [values[m] for m in members] for name, values in ages.items()},
            )
            yield Rows("proposals", rows)
            yield Rows("confidences", _confidences(rows))
        yield from error_rows(found.errors)


def _windows(cue: CueInput, world: World) -> Iterator[_Window]:
    settings: Settings = cue.settings
    by_segment: dict[int, list[Frame]] = {}
    for number, frame in world.frames.items():
        by_segment.setdefault(world.poses.segment[number], []).append(frame)
    for frames in by_segment.values():
        for first, last in even_spans(len(frames), largest=settings.window_frames, fewest=2):
            start = max(first - settings.margin_frames, 0)
            window = tuple(frames[start : last + settings.margin_frames])
            yield _Window(
                dataset=cue.dataset,
                sensor=cue.info.sensor,
                metric_scale=cue.info.metric_scale,
                settings=settings,
                world=World(
                    {f.frame: f for f in window},
                    world.poses.only([f.frame for f in window]),
                    world.interval_s,
                    world.timed,
                ),
                frames=window,
                evidence={f.frame: _inputs(cue, f) for f in window},
                first=first - start,
                last=last - start,
            )


def _inputs(cue: CueInput, frame: Frame) -> dict[str, EncodedPoints]:
    rows = ((name, read_encoded(cue.tables, frame.frame, name)) for name in _EVIDENCE)
    return {name: row for name, row in rows if row is not None}


@dataclass(frozen=True)
class _Sweep:
    xyz: Float32Array
    evidence: dict[str, Any]


def _read(window: _Window, frame: Frame) -> _Sweep | str | None:
    """Return a frame's points and evidence, why it cannot be read, or None without evidence."""
    inputs = window.evidence[frame.frame]
    if len(inputs) < len(_EVIDENCE):
        return None
    try:
        xyz = window.dataset.read_points(frame).xyz
    except FrameError as error:
        return str(error)
    return _Sweep(xyz, {name: decode_matching(row, len(xyz)) for name, row in inputs.items()})


def _measure_window(window: _Window) -> _Found:
    limits = window.settings.map.scaled(window.metric_scale)
    points = _map(window, limits)
    objects = static_objects(points, limits, EDGE_MARGIN_M * window.metric_scale)
    found = _Found(objects, [], [])
    for frame in window.frames[window.first : window.last]:
        sweep = _read(window, frame)
        if isinstance(sweep, str):
            found.errors.append((frame.frame, sweep))
        elif sweep is not None:
            members, columns = _frame_columns(window, frame, sweep, objects, limits)
            if members:
                found.frames.append((frame.frame, members, columns))
    return found


def _map(window: _Window, limits: MapSettings) -> Float32Array:
    """Return (N, 4) thinned points of the window: world x, y, z and height above the ground."""
    parts: list[Float32Array] = [np.empty((0, 4), dtype=np.float32)]
    for frame in window.frames[:: window.settings.every_frames]:
        sweep = _read(window, frame)
        if not isinstance(sweep, _Sweep):
            continue
        chosen = map_points(
            sweep.xyz,
            sweep.evidence["height_m"],
            sweep.evidence["votes_static"],
            sweep.evidence["ground"],
            frame.sensor_matrix[:3, 3],
            limits,
        )
        moved = window.world.point_to_world(frame.frame, sweep.xyz[chosen].astype(np.float64))
        height = sweep.evidence["height_m"][chosen]
        parts.append(thin(np.column_stack([moved, height]).astype(np.float32), limits.voxel_m))
    return thin(np.concatenate(parts), limits.voxel_m)


def _frame_columns(
    window: _Window,
    frame: Frame,
    sweep: _Sweep,
    objects: list[StaticObject],
    limits: MapSettings,
) -> tuple[list[int], Columns]:
    """Return which objects a frame shows, and what it shows of them."""
    settings, scale = window.settings, window.metric_scale
    solid = np.flatnonzero(~sweep.evidence["ground"])
    xyz = sweep.xyz[solid]
    sensor = frame.sensor_matrix[:3, 3]
    boxes = [window.world.box_to_level(frame.frame, item.box) for item in objects]
    members: list[int] = []
    inside: list[IntArray] = []
    for number, box in enumerate(boxes):
        if np.hypot(box[0] - sensor[0], box[2] - sensor[2]) > limits.reach_m:
            continue
        points = solid[points_in_box(xyz, box, settings.grow_m * scale)]
        if len(points) >= settings.least_points:
            members.append(number)
            inside.append(points)
    if not members:
        return [], {}
    chosen = np.array([boxes[m] for m in members])
    grid = sensor_grid(frame, window.sensor, LidarCells())
    image = range_image(sweep.xyz, grid)
    return members, merged(
        box_columns(chosen, frame),
        point_columns(inside, sweep.evidence["height_m"]),
        vote_columns(inside, sweep.evidence["votes_free"], sweep.evidence["votes_static"]),
        occluded_columns(chosen, grid, image, settings.front_m * scale),
    )


class _Names:
    """Numbers objects through the windows: one that was there in the last window keeps its own."""

    def __init__(self) -> None:
        self._next = 0
        self._boxes: FloatArray = np.empty((0, 7))
        self._numbers: list[int] = []

    def number(self, objects: list[StaticObject], same_iou: float) -> list[int]:
        """Return the numbers of a window's objects."""
        boxes = np.array([item.box for item in objects]).reshape(-1, 7)
        overlap = bev_iou(boxes, self._boxes)
        numbers = [-1] * len(objects)
        pairs = np.argwhere(overlap >= same_iou)
        taken: set[int] = set()
        for i, j in sorted(pairs.tolist(), key=lambda pair: (-overlap[pair[0], pair[1]], pair)):
            if numbers[i] < 0 and j not in taken:
                numbers[i] = self._numbers[j]
                taken.add(j)
        for i, number in enumerate(numbers):
            if number < 0:
                numbers[i] = self._next
                self._next += 1
        self._boxes, self._numbers = boxes, numbers
        return numbers


def _ages(found: _Found) -> dict[str, list[Any]]:
    """Return what the window's frames say of each object: its sightings and its votes."""
    frames: list[list[int]] = [[] for _ in found.objects]
    points: list[list[int]] = [[] for _ in found.objects]
    shares: list[list[float]] = [[] for _ in found.objects]
    ranges: list[list[float]] = [[] for _ in found.objects]
    for frame, members, columns in found.frames:
        for i, member in enumerate(members):
            frames[member].append(frame)
            points[member].append(columns["number_of_points"][i])
            shares[member].append(columns["core_share"][i])
            ranges[member].append(columns["range_m"][i])
    return {
        "age_frames": [len(f) for f in frames],
        "span_frames": [f[-1] - f[0] + 1 if f else 0 for f in frames],
        "track_points": [float(np.median(p)) if p else None for p in points],
        "track_core_share": [float(np.median(s)) if s else None for s in shares],
        "track_range_min_m": [min(r) if r else None for r in ranges],
    }


def _object_columns(
    cue: CueInput, objects: list[StaticObject], members: list[int], numbers: list[int]
) -> Columns:
    chosen = [objects[m] for m in members]
    base = f"{cue.info.dataset}/{cue.info.sequence}/static"
    return {
        "track_id": [f"{base}/{numbers[m]:04d}" for m in members],
        "edge_share": [item.edge_share for item in chosen],
        "fit_residual_m": [item.fit_residual_m for item in chosen],
        "fill_share": [item.fill_share for item in chosen],
        "track_height_m": [float(item.box[5]) for item in chosen],
        "travel_m": [0.0] * len(chosen),
        "path_length_m": [0.0] * len(chosen),
        "frames_from_observation": [0] * len(chosen),
    }


def _confidences(rows: Columns) -> Columns:
    """Return the rows of module `shape`: the share of an object's voxels near a side of its box."""
    count = len(rows["proposal_id"])
    return {
        "proposal_id": rows["proposal_id"],
        "frame": rows["frame"],
        "module": ["shape"] * count,
        "confidence": rows["edge_share"],
        "raw_value": rows["edge_share"],
        "unit": ["share of voxels"] * count,
    }
