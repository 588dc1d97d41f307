"""What stands on a table before a static depth camera: connected surfaces, followed and completed.

Depth is averaged over neighbouring frames, the table's plane found, and what rises above it cut
into connected regions. Each region is a row twice: as a box (fit min_area, the smallest rectangle
from above) and as what is round from above (fit round, a square along the line of sight, whose yaw
means nothing). Which of the two it is is for a rule to say, by how much of the rectangle its points
fill.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.depth_frames import AveragingSettings
from tcrdata.evidence.ground import Settings as PlaneSettings
from tcrdata.evidence.point_rows import error_rows
from tcrdata.evidence.proposal_columns import Columns, box_columns, key_columns, merged
from tcrdata.evidence.table_frames import Chunk, measure_chunk
from tcrdata.evidence.table_regions import Region, RegionSettings
from tcrdata.evidence.table_tracks import TrackedRegion, TrackSettings, follow
from tcrdata.types import CueInput, FloatArray, Frame, Rows

NEEDS: tuple[str, ...] = ()
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False

SURE_POINTS = 500
"""Points of a track, in the median, with which it is as sure as can be: scales a confidence."""

_FITS = ("min_area", "round")


@dataclass(frozen=True)
class Settings:
    """How a table's objects are found; metres are multiplied by the sequence's metric scale.

    Attributes:
        averaging: of the depth.
        regions: how they are cut out.
        tracks: how they are followed and completed.
        fuse_cameras: lay together what several cameras see of one scene.
        chunk_frames: frames an item of work.
    """

    averaging: AveragingSettings = field(default_factory=AveragingSettings)
    regions: RegionSettings = field(default_factory=RegionSettings)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    fuse_cameras: bool = True
    chunk_frames: int = 25


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source table, and their `confidences`.

    A sequence of LiDAR sweeps, or without a camera, gives no rows.
    """
    if cue.info.sensor != "depth":
        return
    regions: list[Region] = []
    unreadable: set[int] = set()
    for found, errors in cue.parallel(measure_chunk, _chunks(cue)):
        regions += found
        unreadable.update(number for number, _ in errors)
        yield from error_rows(errors)
    numbers = [frame.frame for frame in cue.frames if frame.frame not in unreadable]
    tracked = follow(regions, numbers, cue.settings.tracks, cue.info.metric_scale)
    by_frame: dict[int, list[TrackedRegion]] = {}
    for entry in tracked:
        by_frame.setdefault(entry.region.frame, []).append(entry)
    for frame in cue.frames:
        for fit in _FITS if frame.frame in by_frame else ():
            rows = _columns(cue, frame, fit, by_frame[frame.frame])
            yield Rows("proposals", rows)
            yield Rows("confidences", _confidences(rows))


def _chunks(cue: CueInput) -> Iterator[Chunk]:
    settings: Settings = cue.settings
    scale, half = cue.info.metric_scale, settings.averaging.half_window_frames
    regions = replace(
        settings.regions,
        above_m=settings.regions.above_m * scale,
        gap_m=settings.regions.gap_m * scale,
        front_m=settings.regions.front_m * scale,
        voxel_m=settings.regions.voxel_m * scale,
    )
    plane = PlaneSettings()
    plane = replace(plane, plane_margin_m=plane.plane_margin_m * scale)
    start = 0
    for frames in chunked(cue.frames, settings.chunk_frames):
        before = max(start - half, 0)
        window = cue.frames[before : start + len(frames) + half]
        first = start - before
        yield Chunk(
            dataset=cue.dataset,
            window=window,
            first=first,
            last=first + len(frames),
            averaging=settings.averaging,
            regions=regions,
            plane=plane,
            fuse_cameras=settings.fuse_cameras,
        )
        start += len(frames)


def _columns(cue: CueInput, frame: Frame, fit: str, entries: list[TrackedRegion]) -> Columns:
    """Return a frame's rows of one fit."""
    boxes = np.array([e.disc if fit == "round" else e.box for e in entries])
    base = f"{cue.info.dataset}/{cue.info.sequence}/table"
    return merged(
        key_columns(frame, "table", fit, range(len(entries)), cue.info.metric_scale, cue.round),
        box_columns(boxes, frame),
        _seen_in_image(entries, boxes, frame),
        {
            "track_id": [f"{base}/{e.track:04d}" for e in entries],
            "number_of_points": [len(e.region.points) for e in entries],
            "point_indices": [e.region.points.tolist() for e in entries],
            "bottom_above_ground_m": [e.region.heights_m[0] for e in entries],
            "top_above_ground_m": [e.region.heights_m[1] for e in entries],
            "occluded_share": [e.region.image_hidden_share for e in entries],
            "yaw_observable": [fit != "round"] * len(entries),
            "fill_share": [e.region.fill_share for e in entries],
            "age_frames": [e.age_frames for e in entries],
            "span_frames": [e.span_frames for e in entries],
            "track_points": [e.points for e in entries],
            "track_fill_share": [e.fill_share for e in entries],
            "frames_from_observation": [0] * len(entries),
        },
    )


def _seen_in_image(entries: list[TrackedRegion], boxes: FloatArray, frame: Frame) -> Columns:
    """Return the 2D boxes: of the pixels where nothing hides a part, else of the 3D box."""
    assert frame.camera is not None
    names = ("left_px", "top_px", "right_px", "bottom_px")
    projected = box_columns(boxes, frame)
    size = (frame.camera.width_px, frame.camera.height_px)
    columns: Columns = {name: [] for name in names}
    for number, entry in enumerate(entries):
        for side, name in enumerate(names):
            value = projected[name][number]
            if entry.whole_in_image and entry.region.box_px is not None:
                edge = entry.region.box_px[side] + (-0.5 if side < 2 else 0.5)
                value = float(np.clip(edge, 0.0, size[side % 2]))
            columns[name].append(value)
    return columns


def _confidences(rows: Columns) -> Columns:
    """Return the rows of module `outline`: how much of an outline is seen, by how many points.

    1 with as many points as there need be for a sure outline, none of it hidden.
    """
    count = len(rows["proposal_id"])
    shown = np.minimum(np.array(rows["track_points"]) / SURE_POINTS, 1.0)
    return {
        "proposal_id": rows["proposal_id"],
        "frame": rows["frame"],
        "source": rows["source"],
        "module": ["outline"] * count,
        "confidence": (shown * (1.0 - np.array(rows["occluded_share"]))).tolist(),
        "raw_value": rows["occluded_share"],
        "unit": ["share of the outline hidden"] * count,
    }
