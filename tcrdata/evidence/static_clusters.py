"""Objects that stand still: clusters of many sweeps laid over one another in the world.

Windows of frames, each with a margin before and after, are mapped: every third sweep's points that
other sweeps saw too, thinned to voxels, clustered and boxed. Each object becomes a row in every
frame of its window that shows points of it. Neighbouring windows share an object's track_id where
its boxes overlap. Which objects look like vehicles is for rules to say.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tcrdata.evidence.chunks import even_spans
from tcrdata.evidence.point_rows import EncodedPoints, error_rows, read_encoded
from tcrdata.evidence.poses import read_poses
from tcrdata.evidence.proposal_columns import Columns, key_columns, merged
from tcrdata.evidence.static_map import StaticObject
from tcrdata.evidence.static_windows import (
    EVIDENCE,
    Found,
    StaticSettings,
    Window,
    measure_window,
)
from tcrdata.evidence.world import World, make_world
from tcrdata.geometry.boxes import bev_iou
from tcrdata.types import CueInput, FloatArray, Frame, Rows

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False

Settings = StaticSettings


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source static and their `confidences`, frame by frame."""
    world = make_world(cue.frames, read_poses(cue.tables))
    names = _Names()
    for found in cue.parallel(measure_window, _windows(cue, world)):
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


def _windows(cue: CueInput, world: World) -> Iterator[Window]:
    settings: StaticSettings = cue.settings
    by_segment: dict[int, list[Frame]] = {}
    for number, frame in world.frames.items():
        by_segment.setdefault(world.poses.segment[number], []).append(frame)
    for frames in by_segment.values():
        for first, last in even_spans(len(frames), largest=settings.window_frames, fewest=2):
            start = max(first - settings.margin_frames, 0)
            window = tuple(frames[start : last + settings.margin_frames])
            yield Window(
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
    rows = ((name, read_encoded(cue.tables, frame.frame, name)) for name in EVIDENCE)
    return {name: row for name, row in rows if row is not None}


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


def _ages(found: Found) -> dict[str, list[Any]]:
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
        "source": rows["source"],
        "module": ["shape"] * count,
        "confidence": rows["edge_share"],
        "raw_value": rows["edge_share"],
        "unit": ["share of voxels"] * count,
    }
