"""Objects that move, followed over time: their clusters linked, refined, filled and extended.

The clusters of single frames (source free_space) are linked in the world; each track's boxes are
refined over all of its frames; gaps are filled and ends extended; what the sweeps show of every
such box goes into a second refinement. Every track is a row in each of its frames, however poor:
which of them moved is for rules to say. Only what no rule could accept, for want of sightings or
of any change of place, is not refined: its clusters stay rows of source free_space.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from tcrdata.evidence.chunks import chunked, even_spans
from tcrdata.evidence.linked_clusters import Clusters, link_clusters, read_clusters
from tcrdata.evidence.linking import LinkingSettings
from tcrdata.evidence.point_rows import EncodedPoints, error_rows, read_encoded
from tcrdata.evidence.poses import read_poses
from tcrdata.evidence.proposal_columns import stacked
from tcrdata.evidence.refinement import RefineTask, refine_chunk
from tcrdata.evidence.sightings import RefinementSettings
from tcrdata.evidence.track_frames import (
    BoxLook,
    ChunkTask,
    FrameFailure,
    FrameTask,
    ProbeSettings,
    gather_chunk,
    look_chunk,
)
from tcrdata.evidence.track_paths import (
    Place,
    Shape,
    Sighting,
    Track,
    kept_places,
    places_of,
    prepared,
    shape_of,
)
from tcrdata.evidence.track_rows import (
    Finished,
    confidence_columns,
    frame_columns,
    statistics,
)
from tcrdata.evidence.world import World, make_world
from tcrdata.types import CueInput, Float32Array, FloatArray, IntArray, Rows

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space", "regions_free_space")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False

FRAMES_A_BATCH = 16
"""Frames whose rows are written at once."""

_EVIDENCE = ("ground", "votes_free", "votes_static")


@dataclass(frozen=True)
class Settings:
    """How tracks are made; metres are multiplied by the sequence's metric scale.

    Attributes:
        linking: gates of the association.
        refinement: of one track over all of its frames.
        first_passes: passes of the first refinement, which only has to place the boxes.
        probe: how boxes are looked at in a frame.
        least_sightings: shorter tracks are no rows; every rule asks for more.
        least_spread_m: tracks whose clusters all lie closer together are none either; every rule
            asks for more travel.
        extend_frames: most frames beyond a track's ends; every rule asks for fewer.
        trusted_frames: extensions farther than this from a sighting take no part in refining the
            track, claim no place from others, and follow the refined path's ends: they are there
            for rules that ask for more, and change nothing else.
        fill_points: an extension ends where fewer points are in the box; every rule asks for more.
        most_points: points of a cluster that refinement keeps.
        chunk_frames: most frames an item of work.
        chunk_tracks: most tracks an item of work.
    """

    linking: LinkingSettings = field(default_factory=LinkingSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    first_passes: int = 2
    probe: ProbeSettings = field(default_factory=ProbeSettings)
    least_sightings: int = 2
    least_spread_m: float = 0.5
    extend_frames: int = 10
    trusted_frames: int = 5
    fill_points: int = 5
    most_points: int = 256
    chunk_frames: int = 50
    chunk_tracks: int = 16


@dataclass
class _Work:
    """What the steps below share."""

    cue: CueInput
    settings: Settings
    refinement: RefinementSettings
    world: World
    clusters: Clusters
    failures: dict[int, str] = field(default_factory=dict)


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source track and their `confidences`, frame by frame."""
    work = _prepare(cue)
    tracks = _link(work)
    shapes = _refine_clusters(work, tracks)
    reach = (work.settings.extend_frames, work.settings.trusted_frames)
    places = [places_of(t, s, work.world, *reach) for t, s in shapes]
    looks = _look(work, places)
    yield from _rows(work, _refine_places(work, [t for t, _ in shapes], places, looks))
    yield from error_rows(sorted(work.failures.items()))


def _prepare(cue: CueInput) -> _Work:
    settings: Settings = cue.settings
    world = make_world(cue.frames, read_poses(cue.tables))
    refinement = settings.refinement.scaled(cue.info.metric_scale)
    return _Work(cue, settings, refinement, world, read_clusters(cue.tables, world))


def _link(work: _Work) -> list[Track]:
    linked = link_clusters(work.cue, work.clusters, work.world, work.settings.linking)
    enough = [rows for rows in linked if _goes_anywhere(work, rows)]
    return [Track(i, rows, work.clusters.frame[rows]) for i, rows in enumerate(enough)]


def _goes_anywhere(work: _Work, rows: IntArray) -> bool:
    """Return whether a rule could accept a track of these clusters; bounds the work, no more."""
    centers = work.clusters.world[rows][:, [0, 2]]
    spread = np.hypot(*np.ptp(centers, axis=0)) / work.cue.info.metric_scale
    return bool(
        len(rows) >= work.settings.least_sightings and spread >= work.settings.least_spread_m
    )


def _refine_clusters(work: _Work, tracks: list[Track]) -> list[tuple[Track, Shape]]:
    """Refine each track on its clusters' points alone, trusting every edge."""
    points = _gather(work, tracks)
    above = np.nan_to_num(work.clusters.numbers["bottom_above_ground_m"])
    quick = replace(work.refinement, passes=work.settings.first_passes)
    readable, seen = [], []
    for track in tracks:
        sightings = [
            Sighting(int(frame), points[row], float(above[row]), np.zeros(4, dtype=bool), True)
            for row, frame in zip(track.rows.tolist(), track.frame.tolist(), strict=True)
            if len(points.get(row, ()))
        ]
        if sightings:
            readable.append(track)
            seen.append(sightings)
    return list(zip(readable, _shapes(work, seen, quick), strict=True))


def _shapes(
    work: _Work, tracks: list[list[Sighting]], settings: RefinementSettings
) -> Iterator[Shape]:
    """Refine each track, given its sightings; tracks are many and short, so some an item."""
    ready = [prepared(sightings, work.world) for sightings in tracks]
    tasks = (
        RefineTask(tuple(t.seen for t in part), settings, work.world.interval_s)
        for part in chunked(ready, work.settings.chunk_tracks)
    )
    paths = (path for chunk in work.cue.parallel(refine_chunk, tasks) for path in chunk)
    for track, path in zip(ready, paths, strict=True):
        yield shape_of(track, path, settings)


def _gather(work: _Work, tracks: list[Track]) -> dict[int, Float32Array]:
    """Return the thinned points of each cluster that is in a track."""
    wanted: dict[int, list[int]] = {}
    for track in tracks:
        for row, frame in zip(track.rows.tolist(), track.frame.tolist(), strict=True):
            wanted.setdefault(frame, []).append(row)
    frames = sorted(wanted)
    tasks = {
        f: FrameTask(
            work.world.frames[f],
            np.empty((0, 7)),
            tuple(work.clusters.indices[row] for row in wanted[f]),
        )
        for f in frames
    }
    points: dict[int, Float32Array] = {}
    results = work.cue.parallel(gather_chunk, _chunks(work, tasks, evidence=False))
    for frame, found in zip(frames, (r for chunk in results for r in chunk), strict=True):
        if isinstance(found, FrameFailure):
            work.failures[frame] = found.error
        else:
            points.update(zip(wanted[frame], found, strict=True))
    return points


def _chunks(work: _Work, tasks: dict[int, FrameTask], *, evidence: bool) -> Iterator[ChunkTask]:
    frames = sorted(tasks)
    for first, last in even_spans(len(frames), largest=work.settings.chunk_frames, fewest=2):
        part = []
        for frame in frames[first:last]:
            task = tasks[frame]
            read = _read_evidence(work, frame) if evidence else ()
            part.append(replace(task, evidence=read))
        yield ChunkTask(
            dataset=work.cue.dataset,
            sensor=work.cue.info.sensor,
            metric_scale=work.cue.info.metric_scale,
            settings=work.settings.probe,
            most_points=work.settings.most_points,
            frames=tuple(part),
        )


def _read_evidence(work: _Work, frame: int) -> tuple[EncodedPoints, ...]:
    found = (read_encoded(work.cue.tables, frame, name) for name in _EVIDENCE)
    return tuple(row for row in found if row is not None)


def _look(work: _Work, places: list[list[Place]]) -> list[list[BoxLook | None]]:
    """Return what each place's frame shows of it; None for too little, or an unreadable frame."""
    wanted: dict[int, list[tuple[int, int]]] = {}
    for t, track_places in enumerate(places):
        for i, place in enumerate(track_places):
            wanted.setdefault(place.frame, []).append((t, i))
    none: IntArray = np.empty(0, dtype=np.int64)
    tasks = {}
    for frame, keys in wanted.items():
        here = [places[t][i] for t, i in keys]
        boxes: FloatArray = np.array([work.world.box_to_level(frame, p.box) for p in here])
        indices = tuple(work.clusters.indices[p.row] if p.row >= 0 else none for p in here)
        least = tuple(work.settings.fill_points * (p.found == "extended") for p in here)
        tasks[frame] = FrameTask(work.world.frames[frame], boxes, indices, least)
    looks: list[list[BoxLook | None]] = [[None] * len(p) for p in places]
    results = work.cue.parallel(look_chunk, _chunks(work, tasks, evidence=True))
    for frame, found in zip(sorted(tasks), (r for chunk in results for r in chunk), strict=True):
        if isinstance(found, FrameFailure):
            work.failures[frame] = found.error
            continue
        for (t, i), look in zip(wanted[frame], found, strict=True):
            looks[t][i] = look
    return looks


def _refine_places(
    work: _Work,
    tracks: list[Track],
    places: list[list[Place]],
    looks: list[list[BoxLook | None]],
) -> list[Finished]:
    """Refine the tracks again, on all that their places show; drop what cannot be read."""
    above = np.nan_to_num(work.clusters.numbers["bottom_above_ground_m"])
    parts, seen = [], []
    for track, there, shown in zip(tracks, places, looks, strict=True):
        if all(k is None or p.found != "observed" for p, k in zip(there, shown, strict=True)):
            continue
        kept = kept_places(there, shown)
        parts.append((track, *kept))
        seen.append(_sightings(*kept, above, work.settings.fill_points))
    shapes = _shapes(work, seen, work.refinement)
    return [Finished(t, shape, p, k) for (t, p, k), shape in zip(parts, shapes, strict=True)]


def _sightings(
    places: list[Place], looks: list[BoxLook], above: FloatArray, fill_points: int
) -> list[Sighting]:
    return [
        Sighting(
            place.frame,
            look.xyz,
            float(above[place.row]) if place.row >= 0 else 0.0,
            look.hidden,
            place.found == "observed",
        )
        for place, look in zip(places, looks, strict=True)
        if place.trusted and len(look.xyz) >= (1 if place.found == "observed" else fill_points)
    ]


def _rows(work: _Work, finished: list[Finished]) -> Iterator[Rows]:
    info = work.cue.info
    entries: dict[int, list[tuple[Finished, int, dict[str, object]]]] = {}
    for item in finished:
        stats = statistics(item, work.clusters, work.world, info)
        for i, place in enumerate(item.places):
            entries.setdefault(place.frame, []).append((item, i, stats))
    for frames in chunked(sorted(entries), FRAMES_A_BATCH):
        rows = [frame_columns(f, entries[f], work.clusters, work.world, info) for f in frames]
        yield Rows("proposals", stacked(rows))
        yield Rows("confidences", stacked([c for part in rows for c in confidence_columns(part)]))
