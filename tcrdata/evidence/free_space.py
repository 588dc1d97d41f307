"""Free space over many sweeps: what is here now and was not there then has moved.

Each point that is no ground is carried into sweeps before and after. Where such a sweep saw the
same surface, it votes static; where it saw something nearer, it could not see the place; where it
saw only farther things, the place was free, so that the point belongs to something that moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import even_spans
from tcrdata.evidence.point_rows import (
    EncodedPoints,
    decode_matching,
    encoded,
    error_rows,
    point_rows,
    read_encoded,
)
from tcrdata.evidence.poses import Poses, read_poses
from tcrdata.evidence.range_images import (
    LidarCells,
    RangeGrid,
    RangeImage,
    range_image,
    sensor_grid,
)
from tcrdata.evidence.reach import solid_within
from tcrdata.evidence.votes import add_votes
from tcrdata.types import (
    CueInput,
    Dataset,
    Float32Array,
    Frame,
    ImageArray,
    IntArray,
    Rows,
    Sensor,
    SequenceInfo,
)

NEEDS: tuple[str, ...] = ("ground", "odometry")
GIVES: tuple[str, ...] = ("point_evidence",)
NEEDS_IMAGES: bool = False

VOTES = ("votes_free", "votes_static", "votes_occluded")


@dataclass(frozen=True)
class Settings:
    """How votes are counted; metres are multiplied by the sequence's metric scale.

    Attributes:
        offsets_frames: sweeps asked, this many frames before and after, at the usual interval.
        interval_s: the usual time between frames; with frames k times as dense, offsets are k
            times as long (k rounded, at least 1).
        margin_m: ranges this near are equal.
        margin_share: LiDAR: and this share of the range on top.
        depth_margin_share: depth: the same; frames taken from nearly one place need less.
        least_far: farther returns in the 3x3 window that make a free vote.
        reach_m: points farther than this from the sensor get no votes.
        azimuth_deg: width of a cell of a LiDAR's range image.
        elevation_deg: height of a cell.
        lowest_deg: lowest elevation with a cell.
        highest_deg: highest elevation with a cell.
        chunk_frames: most frames an item of work.
    """

    offsets_frames: tuple[int, ...] = (1, 2, 3, 5, 7, 10, 15, 20)
    interval_s: float = 0.1
    margin_m: float = 0.3
    margin_share: float = 0.008
    depth_margin_share: float = 0.002
    least_far: int = 2
    reach_m: float = 80.0
    azimuth_deg: float = LidarCells.azimuth_deg
    elevation_deg: float = LidarCells.elevation_deg
    lowest_deg: float = LidarCells.lowest_deg
    highest_deg: float = LidarCells.highest_deg
    chunk_frames: int = 50


@dataclass(frozen=True)
class _Chunk:
    """Frames `first` to `last - 1` of a window that holds their neighbours too."""

    dataset: Dataset
    sensor: Sensor
    settings: Settings
    window: tuple[Frame, ...]
    poses: Poses
    ground: dict[int, EncodedPoints]
    first: int
    last: int


@dataclass(frozen=True)
class _Sweep:
    """One frame of the window, read: its range image, and its points until they are judged."""

    image: RangeImage
    grid: RangeGrid
    xyz: Float32Array
    asked: IntArray


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `point_evidence` rows of the cues votes_free, votes_static, votes_occluded (u8)."""
    settings = _adapted(cue.settings, cue.info, cue.frames)
    for points, errors in cue.parallel(_vote_chunk, _chunks(cue, settings)):
        yield point_rows(points)
        yield from error_rows(errors)


def _adapted(settings: Settings, info: SequenceInfo, frames: tuple[Frame, ...]) -> Settings:
    """Return the settings in this sequence's metres and at its frame rate."""
    steps_ns = np.diff([frame.timestamp_ns for frame in frames])
    usual_s = float(np.median(steps_ns)) / 1e9 if len(steps_ns) else settings.interval_s
    density = max(round(settings.interval_s / usual_s), 1) if usual_s > 0 else 1
    share = settings.margin_share if info.sensor == "lidar" else settings.depth_margin_share
    return replace(
        settings,
        offsets_frames=tuple(offset * density for offset in settings.offsets_frames),
        margin_m=settings.margin_m * info.metric_scale,
        margin_share=share,
        reach_m=settings.reach_m * info.metric_scale,
    )


def _chunks(cue: CueInput, settings: Settings) -> Iterator[_Chunk]:
    poses = read_poses(cue.tables)
    reach = max(settings.offsets_frames, default=0)
    for first, last in even_spans(len(cue.frames), largest=settings.chunk_frames, fewest=2):
        start = max(first - reach, 0)
        window = cue.frames[start : last + reach]
        ground = (
            read_encoded(cue.tables, frame.frame, "ground") for frame in cue.frames[first:last]
        )
        yield _Chunk(
            dataset=cue.dataset,
            sensor=cue.info.sensor,
            settings=settings,
            window=window,
            poses=poses.only([frame.frame for frame in window]),
            ground={row.frame: row for row in ground if row is not None},
            first=first - start,
            last=last - start,
        )


def _grid(frame: Frame, sensor: Sensor, settings: Settings) -> RangeGrid:
    cells = LidarCells(
        settings.azimuth_deg, settings.elevation_deg, settings.lowest_deg, settings.highest_deg
    )
    return sensor_grid(frame, sensor, cells)


def _vote_chunk(chunk: _Chunk) -> tuple[list[EncodedPoints], list[tuple[int, str]]]:
    """Slide over the chunk, so that only the sweeps within reach are in memory."""
    reach = max(chunk.settings.offsets_frames, default=0)
    sweeps: dict[int, _Sweep | str] = {}
    points: list[EncodedPoints] = []
    errors: list[tuple[int, str]] = []
    for index in range(chunk.first, chunk.last):
        for other in range(max(index - reach, 0), min(index + reach + 1, len(chunk.window))):
            if other not in sweeps:
                sweeps[other] = _read(chunk, other)
        sweeps.pop(index - reach - 1, None)
        number = chunk.window[index].frame
        sweep = sweeps[index]
        if isinstance(sweep, str):
            errors.append((number, sweep))
            continue
        votes = _votes(chunk, index, sweep, sweeps)
        points += [encoded(number, cue, "u8", votes[i]) for i, cue in enumerate(VOTES)]
        sweeps[index] = replace(sweep, xyz=sweep.xyz[:0], asked=sweep.asked[:0])
    return points, errors


def _read(chunk: _Chunk, index: int) -> _Sweep | str:
    """Return a frame of the window, or why it cannot be read."""
    frame = chunk.window[index]
    try:
        xyz = chunk.dataset.read_points(frame).xyz
    except FrameError as error:
        return str(error)
    grid = _grid(frame, chunk.sensor, chunk.settings)
    image = range_image(xyz, grid)
    if not chunk.first <= index < chunk.last:
        return _Sweep(image, grid, xyz[:0], np.empty(0, np.int64))
    return _Sweep(image, grid, xyz, _asked(chunk, frame, xyz))


def _asked(chunk: _Chunk, frame: Frame, xyz: Float32Array) -> IntArray:
    """Return the indices of the points that get votes: no ground, within reach."""
    ground = chunk.ground.get(frame.frame)
    if ground is None:
        return np.empty(0, np.int64)
    is_ground = decode_matching(ground, len(xyz))
    return solid_within(xyz, is_ground, frame.sensor_matrix[:3, 3], 0.0, chunk.settings.reach_m)


def _votes(chunk: _Chunk, index: int, sweep: _Sweep, sweeps: dict[int, _Sweep | str]) -> ImageArray:
    """Return (3, N) votes on all points of a frame of the window."""
    settings, frame = chunk.settings, chunk.window[index].frame
    points = np.ascontiguousarray(sweep.xyz.take(sweep.asked, axis=0).T)
    counted = np.zeros((3, len(sweep.asked)), np.uint8)
    for offset in settings.offsets_frames:
        for other in (index - offset, index + offset):
            asked = sweeps.get(other)
            if not isinstance(asked, _Sweep):
                continue
            number = chunk.window[other].frame
            if not chunk.poses.linked(number, frame):
                continue
            add_votes(
                counted,
                points,
                asked.image,
                asked.grid,
                chunk.poses.a_T_b(number, frame),
                margin_m=settings.margin_m,
                margin_share=settings.margin_share,
                least_far=settings.least_far,
            )
    votes = np.zeros((3, len(sweep.xyz)), np.uint8)
    # Kind by kind: numpy picks along the last axis of one array several times as fast.
    for kind, count in zip(votes, counted, strict=True):
        kind[sweep.asked] = count
    return votes
