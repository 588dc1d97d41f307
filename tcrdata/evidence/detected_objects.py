"""Detections that persist: what a trained detector sees at one place of the world again and again.

Detections of many frames that lie near one another in the world are one object that stands still.
Its box is fitted to the points of all its frames, and it becomes a row in every frame in which its
place could be seen, whether the detector found it there or not. How often it was found, how surely,
and how many of its points other sweeps saw through are columns; what is enough is for rules to say.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.detected_frames import (
    EVIDENCE,
    Chunk,
    Lookup,
    Place,
    Shown,
    object_columns,
    standing_points,
)
from tcrdata.evidence.detected_rows import confidence_columns, key_rows, persistence, statistics
from tcrdata.evidence.detection_groups import Detections, Group, in_world, standing_groups
from tcrdata.evidence.models import ModelChoice, chosen_model
from tcrdata.evidence.point_rows import EncodedPoints, error_rows, read_encoded
from tcrdata.evidence.poses import read_poses
from tcrdata.evidence.proposal_columns import merged
from tcrdata.evidence.standing_boxes import FitSettings, fitted
from tcrdata.evidence.static_map import thin
from tcrdata.evidence.world import World, make_world
from tcrdata.types import BOX_COLUMNS, CueInput, Float32Array, FloatArray, Frame, Rows

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space", "objectness3d")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False
NEEDS_MODEL = "detector"

DETECTOR = "detector"
EVIDENCE_ROUND = 1
"""The round whose geometry is read: it is measured once."""


@dataclass(frozen=True)
class Settings:
    """How detections are grouped; metres are multiplied by the sequence's metric scale.

    Attributes:
        model: the detector's id or its beginning; empty for the newest of an earlier round.
        model_store: store that holds it; empty for this one.
        least_score: fainter detections are left out.
        reach_m: detections so near the surest one are the same object.
        gap_frames: a longer pause ends an object, and it shows no farther beyond its ends.
        fewest: detections of an object.
        fit: how the box is fitted.
        own_m: points this far outside of the fitted box are its own.
        front_m: a return this much nearer hides a box's outline.
        hidden_share: a place of which more is hidden cannot be seen.
        chunk_frames: frames an item of work.
    """

    model: str = ""
    model_store: str = ""
    least_score: float = 0.1
    reach_m: float = 1.3
    gap_frames: int = 30
    fewest: int = 2
    fit: FitSettings = field(default_factory=FitSettings)
    own_m: float = 0.1
    front_m: float = 0.5
    hidden_share: float = 0.7
    chunk_frames: int = 8


@dataclass(frozen=True)
class Covered:
    """The ground that the detector sees, metres of a frame; see `tcrdata.networks.grids.Region`."""

    lateral_m: float = np.inf
    near_m: float = -np.inf
    far_m: float = np.inf

    def holds(self, box: FloatArray) -> bool:
        """Whether the centre of a (7,) box lies on it."""
        return bool(abs(box[0]) <= self.lateral_m and self.near_m <= box[2] < self.far_m)


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source detected and their `confidences`, frame by frame."""
    settings, scale = cue.settings, cue.info.metric_scale
    world = make_world(cue.frames, read_poses(cue.tables, round=EVIDENCE_ROUND))
    groups = standing_groups(
        _detections(cue, world), settings.reach_m * scale, settings.gap_frames, settings.fewest
    )
    covered = _covered(cue)
    fit = _scaled(settings.fit, scale)
    loose = [group.box for group in groups]
    lookup = Lookup(fit.reach_m, fit.base_m, fit.voxel_m, settings.front_m * scale, scale)
    points: dict[int, Float32Array] = {}
    for shown in _looked_up(cue, world, groups, loose, covered, lookup, standing_points):
        for number, more in shown.points:
            both = [points[number], more] if number in points else [more]
            points[number] = thin(np.concatenate(both), fit.voxel_m)
    boxes = [_fitted(world, group, points.get(i), fit) for i, group in enumerate(groups)]
    own = replace(lookup, grow_m=settings.own_m * scale)
    looks = list(_looked_up(cue, world, groups, boxes, covered, own, object_columns))
    yield from _rows(cue, world, groups, looks)


def _rows(
    cue: CueInput, world: World, groups: Sequence[Group], looks: Sequence[Shown]
) -> Iterator[Rows]:
    frames = [row for shown in looks for row in shown.rows]
    known = statistics(groups, frames, cue.settings.hidden_share)
    for frame, numbers, columns in frames:
        rows = merged(
            columns,
            key_rows(world.frames[frame], groups, numbers, cue.info.metric_scale, cue.round),
            {name: [values[n] for n in numbers] for name, values in known.items()},
        )
        yield Rows("proposals", rows)
        for confidences in confidence_columns(rows, groups, numbers, frame):
            yield Rows("confidences", confidences)
    yield from error_rows(sorted({error for shown in looks for error in shown.errors}))


def _detections(cue: CueInput, world: World) -> Detections:
    """Return the detections of this round that are sure enough, in the world."""
    rows = cue.tables.read(
        "proposals", columns=["proposal_id", "frame", *BOX_COLUMNS], source=DETECTOR
    )
    words = cue.tables.read(
        "confidences", columns=["proposal_id", "confidence"], module="objectness_3d"
    )
    scores = dict(
        zip(words["proposal_id"].to_pylist(), words["confidence"].to_pylist(), strict=True)
    )
    score = np.array([scores[i] for i in rows["proposal_id"].to_pylist()], dtype=np.float64)
    boxes = np.column_stack([rows[name].to_numpy() for name in BOX_COLUMNS]).reshape(-1, 7)
    kept = np.flatnonzero(score >= cue.settings.least_score)
    frames = rows["frame"].to_numpy()[kept]
    return in_world(world, frames.tolist(), boxes[kept], score[kept])


def _covered(cue: CueInput) -> Covered:
    """Return the ground that the model's network covers."""
    settings: Settings = cue.settings
    choice = ModelChoice(DETECTOR, settings.model, settings.model_store, cue.round)
    network = json.loads(chosen_model(cue.tables, choice)["settings"])["network"]
    names = (name for name in ("lateral_m", "near_m", "far_m") if name in network)
    return Covered(**{name: network[name] * cue.info.metric_scale for name in names})


def _looked_up(
    cue: CueInput,
    world: World,
    groups: Sequence[Group],
    boxes: Sequence[FloatArray],
    covered: Covered,
    lookup: Lookup,
    look: Callable[[Chunk], Shown],
) -> Iterator[Shown]:
    """Look the frames up in which the objects' places are covered."""
    settings: Settings = cue.settings
    chunks = (
        Chunk(
            cue.dataset,
            cue.info.sensor,
            World(
                {frame.frame: frame for frame in frames},
                world.poses.only([frame.frame for frame in frames]),
                world.interval_s,
                world.timed,
            ),
            lookup,
            tuple(_places(cue, world, groups, boxes, covered, frames)),
        )
        for frames in chunked(list(world.frames.values()), settings.chunk_frames)
    )
    return cue.parallel(look, chunks)


def _places(
    cue: CueInput,
    world: World,
    groups: Sequence[Group],
    boxes: Sequence[FloatArray],
    covered: Covered,
    frames: Sequence[Frame],
) -> Iterator[Place]:
    for frame in frames:
        segment, gap = world.poses.segment[frame.frame], cue.settings.gap_frames
        near = [
            (number, world.box_to_level(frame.frame, boxes[number]))
            for number, group in enumerate(groups)
            if group.segment == segment
            and group.frames[0] - gap <= frame.frame <= group.frames[-1] + gap
        ]
        seen = [
            (number, box)
            for number, box in near
            if covered.holds(box) or frame.frame in groups[number].frames
        ]
        if seen:
            yield Place(
                frame,
                _inputs(cue, frame),
                tuple(number for number, _ in seen),
                np.array([box for _, box in seen]),
                np.array([persistence(groups[number]) for number, _ in seen]),
            )


def _inputs(cue: CueInput, frame: Frame) -> dict[str, EncodedPoints]:
    rows = (
        (name, read_encoded(cue.tables, frame.frame, name, round=EVIDENCE_ROUND))
        for name in EVIDENCE
    )
    return {name: row for name, row in rows if row is not None}


def _fitted(
    world: World, group: Group, points: Float32Array | None, fit: FitSettings
) -> FloatArray:
    if points is None:
        return group.box
    sensors = np.array([world.sensor(frame)[[0, 2]] for frame in group.frames])
    return fitted(group.box, points, sensors, fit)


def _scaled(fit: FitSettings, metric_scale: float) -> FitSettings:
    names: dict[str, Any] = {
        name: getattr(fit, name) * metric_scale
        for name in fit.__dataclass_fields__
        if name.endswith("_m")
    }
    return replace(fit, **names)
