"""What stands on a table before a static depth camera: connected surfaces, followed and completed.

Depth is averaged over neighbouring frames, the table's plane found, and what rises above it cut
into connected regions. Each region is a row twice: as a box (fit min_area, the smallest rectangle
from above) and as what is round from above (fit round, a square along the line of sight, whose yaw
means nothing). Which of the two it is is for a rule to say, by how much of the rectangle its points
fill.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.depth_frames import (
    AveragingSettings,
    averaged,
    depth_image,
    depth_noise,
    level_points,
)
from tcrdata.evidence.ground import Settings as PlaneSettings
from tcrdata.evidence.point_rows import error_rows
from tcrdata.evidence.proposal_columns import Columns, box_columns, key_columns, merged
from tcrdata.evidence.table_regions import Region, RegionSettings, cut_regions
from tcrdata.evidence.table_tracks import TrackedRegion, TrackSettings, follow
from tcrdata.types import CueInput, Dataset, Float32Array, FloatArray, Frame, PointCloud, Rows

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
        chunk_frames: frames an item of work.
    """

    averaging: AveragingSettings = field(default_factory=AveragingSettings)
    regions: RegionSettings = field(default_factory=RegionSettings)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    chunk_frames: int = 25


@dataclass(frozen=True)
class _Chunk:
    """Frames `first` to `last - 1` of a window that holds their neighbours too."""

    dataset: Dataset
    window: tuple[Frame, ...]
    first: int
    last: int
    averaging: AveragingSettings
    regions: RegionSettings
    plane: PlaneSettings


@dataclass(frozen=True, eq=False)
class _Shot:
    """One frame of the window: its depth, and the index of each pixel's point."""

    depth: Float32Array
    numbers: NDArray[np.int32]


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source table, and their `confidences`.

    A sequence of LiDAR sweeps, or without a camera, gives no rows.
    """
    if cue.info.sensor != "depth":
        return
    regions: list[Region] = []
    for found, errors in cue.parallel(_measure_chunk, _chunks(cue)):
        regions += found
        yield from error_rows(errors)
    numbers = [frame.frame for frame in cue.frames]
    tracked = follow(regions, numbers, cue.settings.tracks, cue.info.metric_scale)
    by_frame: dict[int, list[TrackedRegion]] = {}
    for entry in tracked:
        by_frame.setdefault(entry.region.frame, []).append(entry)
    for frame in cue.frames:
        for fit in _FITS if frame.frame in by_frame else ():
            rows = _columns(cue, frame, fit, by_frame[frame.frame])
            yield Rows("proposals", rows)
            yield Rows("confidences", _confidences(rows))


def _chunks(cue: CueInput) -> Iterator[_Chunk]:
    settings: Settings = cue.settings
    scale, half = cue.info.metric_scale, settings.averaging.half_window_frames
    regions = replace(
        settings.regions,
        above_m=settings.regions.above_m * scale,
        gap_m=settings.regions.gap_m * scale,
        front_m=settings.regions.front_m * scale,
    )
    plane = PlaneSettings()
    plane = replace(plane, plane_margin_m=plane.plane_margin_m * scale)
    start = 0
    for frames in chunked(cue.frames, settings.chunk_frames):
        before = max(start - half, 0)
        window = cue.frames[before : start + len(frames) + half]
        first = start - before
        yield _Chunk(
            cue.dataset, window, first, first + len(frames), settings.averaging, regions, plane
        )
        start += len(frames)


def _measure_chunk(chunk: _Chunk) -> tuple[list[Region], list[tuple[int, str]]]:
    shots = [_shot(chunk.dataset, frame) for frame in chunk.window]
    errors = [
        (chunk.window[i].frame, shot)
        for i, shot in enumerate(shots)
        if isinstance(shot, str) and chunk.first <= i < chunk.last
    ]
    images = [shot.depth for shot in shots if isinstance(shot, _Shot)]
    noise_m = depth_noise(images)
    regions: list[Region] = []
    for index in range(chunk.first, chunk.last):
        shot, frame = shots[index], chunk.window[index]
        if isinstance(shot, str):
            continue
        near = _neighbours(shots, index, chunk.averaging.half_window_frames)
        depth = averaged(
            np.array([s.depth for s in near]), near.index(shot), noise_m, chunk.averaging
        )
        points = level_points(depth, frame)
        regions += cut_regions(frame.frame, depth, points, shot.numbers, chunk.plane, chunk.regions)
    return regions, errors


def _neighbours(shots: Sequence[_Shot | str], index: int, half: int) -> list[_Shot]:
    around = shots[max(index - half, 0) : index + half + 1]
    return [shot for shot in around if isinstance(shot, _Shot)]


def _shot(dataset: Dataset, frame: Frame) -> _Shot | str:
    """Return a frame's depth image, or why it cannot be read."""
    try:
        cloud: PointCloud = dataset.read_points(frame)
    except FrameError as error:
        return str(error)
    if frame.camera is None or cloud.pixels is None:
        return f"frame {frame.frame} has no depth image"
    depth = depth_image(cloud, frame)
    numbers = np.full(depth.shape, -1, dtype=np.int32)
    numbers[cloud.pixels[:, 1], cloud.pixels[:, 0]] = np.arange(len(cloud), dtype=np.int32)
    return _Shot(depth, numbers)


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
            "occluded_share": [e.region.hidden_share for e in entries],
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
            if entry.clear:
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
