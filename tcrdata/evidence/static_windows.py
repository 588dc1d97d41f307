"""One window of sweeps: mapped, cut into objects, and each object looked up in its frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
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
from tcrdata.evidence.world import World
from tcrdata.geometry.boxes import points_in_box
from tcrdata.types import Dataset, Float32Array, Frame, IntArray, Sensor

EVIDENCE = ("ground", "height_m", "votes_free", "votes_static")


@dataclass(frozen=True)
class StaticSettings:
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
class Window:
    """Frames `first` to `last - 1` give rows; those around them are only mapped."""

    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: StaticSettings
    world: World
    frames: tuple[Frame, ...]
    evidence: dict[int, dict[str, EncodedPoints]]
    first: int
    last: int


@dataclass(frozen=True)
class Found:
    """What a window gives: its objects, and for each frame the rows of some of them."""

    objects: list[StaticObject]
    frames: list[tuple[int, list[int], Columns]]
    errors: list[tuple[int, str]]


@dataclass(frozen=True)
class _Sweep:
    xyz: Float32Array
    evidence: dict[str, Any]


def _read(window: Window, frame: Frame) -> _Sweep | str | None:
    """Return a frame's points and evidence, why it cannot be read, or None without evidence."""
    inputs = window.evidence[frame.frame]
    if len(inputs) < len(EVIDENCE):
        return None
    try:
        xyz = window.dataset.read_points(frame).xyz
    except FrameError as error:
        return str(error)
    return _Sweep(xyz, {name: decode_matching(row, len(xyz)) for name, row in inputs.items()})


def measure_window(window: Window) -> Found:
    """Map a window, cut it into objects, and look each of them up in the window's frames."""
    limits = window.settings.map.scaled(window.metric_scale)
    points = _map(window, limits)
    objects = static_objects(points, limits, EDGE_MARGIN_M * window.metric_scale)
    found = Found(objects, [], [])
    for frame in window.frames[window.first : window.last]:
        sweep = _read(window, frame)
        if isinstance(sweep, str):
            found.errors.append((frame.frame, sweep))
        elif sweep is not None:
            members, columns = _frame_columns(window, frame, sweep, objects, limits)
            if members:
                found.frames.append((frame.frame, members, columns))
    return found


def _map(window: Window, limits: MapSettings) -> Float32Array:
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
    window: Window,
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
