"""Regions that free space shows to move: density clusters of the points that were not there.

Every cluster becomes a row for each fit, however poor: what is too high, too near or hardly free
is for rules to say. The module `free_space` is as sure of a region as its votes agree:
`sum(free) / (sum(free) + sum(static))` over its points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.density import density_clusters
from tcrdata.evidence.occlusion import occluded_columns
from tcrdata.evidence.point_rows import (
    EncodedPoints,
    decode_matching,
    error_rows,
    read_encoded,
)
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    key_columns,
    merged,
    outline_columns,
    point_columns,
    stacked,
    vote_columns,
)
from tcrdata.evidence.range_images import LidarCells, range_image, sensor_grid
from tcrdata.geometry.boxes import BevBox, l_shape_box, min_area_box
from tcrdata.types import (
    CueInput,
    Dataset,
    Float32Array,
    FloatArray,
    Frame,
    ImageArray,
    IntArray,
    PointCloud,
    Rows,
    Sensor,
)

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False

_INPUTS = ("votes_free", "votes_static", "height_m")
_FITS: dict[str, Callable[[NDArray[np.floating]], BevBox]] = {
    "min_area": min_area_box,
    "l_shape": l_shape_box,
}


@dataclass(frozen=True)
class Settings:
    """How regions are cut out; metres are multiplied by the sequence's metric scale.

    The candidates' votes shape the clusters and decide nothing: a rule asks for core points, which
    have more. Without them, clusters join what moves with the static things beside it.

    Attributes:
        candidate_votes: points with fewer free votes are not clustered.
        candidate_ratio: nor points with fewer free votes than this times their static votes.
        eps_m: neighbours are this near.
        vertical_share: vertical distances count this much.
        minimum_neighbours: a core point of a cluster has so many, itself counted.
        minimum_points: smaller clusters are noise.
        stands_m: a region whose lowest point is nearer the ground stands on it.
        edge_margin_m: a point this near a side lies on it.
        occlusion_margin_m: a return this much nearer hides what is behind.
        chunk_frames: frames an item of work.
    """

    candidate_votes: int = 1
    candidate_ratio: float = 0.5
    eps_m: float = 0.7
    vertical_share: float = 0.5
    minimum_neighbours: int = 5
    minimum_points: int = 5
    stands_m: float = 0.5
    edge_margin_m: float = 0.3
    occlusion_margin_m: float = 0.5
    chunk_frames: int = 8


@dataclass(frozen=True)
class _Chunk:
    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: Settings
    frames: tuple[tuple[Frame, dict[str, EncodedPoints]], ...]


@dataclass(frozen=True)
class _Evidence:
    """What is known of one frame's points."""

    cloud: PointCloud
    votes_free: ImageArray
    votes_static: ImageArray
    heights_m: Float32Array


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source free_space, and their `confidences`."""
    settings = _scaled(cue.settings, cue.info.metric_scale)
    items = (
        _Chunk(
            cue.dataset,
            cue.info.sensor,
            cue.info.metric_scale,
            settings,
            tuple((frame, _inputs(cue, frame)) for frame in frames),
        )
        for frames in chunked(cue.frames, settings.chunk_frames)
    )
    for columns, errors in cue.parallel(_measure_chunk, items):
        if columns:
            proposals = stacked(columns)
            yield Rows("proposals", proposals)
            yield Rows("confidences", _confidences(proposals))
        yield from error_rows(errors)


def _scaled(settings: Settings, metric_scale: float) -> Settings:
    names = ("eps_m", "stands_m", "edge_margin_m", "occlusion_margin_m")
    return replace(settings, **{name: getattr(settings, name) * metric_scale for name in names})


def _inputs(cue: CueInput, frame: Frame) -> dict[str, EncodedPoints]:
    rows = ((name, read_encoded(cue.tables, frame.frame, name)) for name in _INPUTS)
    return {name: row for name, row in rows if row is not None}


def _confidences(proposals: Columns) -> Columns:
    count = len(proposals["proposal_id"])
    pairs = list(zip(proposals["votes_free_mean"], proposals["votes_static_mean"], strict=True))
    return {
        "proposal_id": proposals["proposal_id"],
        "frame": proposals["frame"],
        "source": proposals["source"],
        "module": ["free_space"] * count,
        "confidence": [free / (free + static) for free, static in pairs],
        "raw_value": [free for free, _ in pairs],
        "unit": ["votes a point"] * count,
    }


def _measure_chunk(chunk: _Chunk) -> tuple[list[Columns], list[tuple[int, str]]]:
    columns: list[Columns] = []
    errors: list[tuple[int, str]] = []
    for frame, inputs in chunk.frames:
        if len(inputs) < len(_INPUTS):
            continue
        try:
            cloud = chunk.dataset.read_points(frame)
        except FrameError as error:
            errors.append((frame.frame, str(error)))
            continue
        evidence = _Evidence(
            cloud, *(decode_matching(inputs[name], len(cloud)) for name in _INPUTS)
        )
        columns += _proposals(chunk, frame, evidence)
    return columns, errors


def _proposals(chunk: _Chunk, frame: Frame, evidence: _Evidence) -> list[Columns]:
    """Return one batch of columns a fit, none when the frame has no region."""
    members = regions(
        evidence.cloud.xyz, evidence.votes_free, evidence.votes_static, chunk.settings
    )
    if not members:
        return []
    xyz, settings = evidence.cloud.xyz, chunk.settings
    grid = sensor_grid(frame, chunk.sensor, LidarCells())
    image = range_image(xyz, grid)
    of_points = merged(
        point_columns(members, evidence.heights_m),
        vote_columns(members, evidence.votes_free, evidence.votes_static),
    )
    batches = []
    for fit, function in _FITS.items():
        rectangles = [function(xyz[m][:, [0, 2]]) for m in members]
        boxes = _boxes(rectangles, members, evidence, settings.stands_m)
        points_xz = [xyz[m][:, [0, 2]] for m in members]
        batches.append(
            merged(
                key_columns(frame, "free_space", fit, range(len(members)), chunk.metric_scale),
                box_columns(boxes, frame),
                of_points,
                outline_columns(boxes, points_xz, settings.edge_margin_m),
                occluded_columns(boxes, grid, image, settings.occlusion_margin_m),
                {"fill_share": [r.fill_share for r in rectangles]},
            )
        )
    return batches


def regions(
    xyz: Float32Array, votes_free: ImageArray, votes_static: ImageArray, settings: Settings
) -> list[IntArray]:
    """Return the clusters of the points that free space shows to move, as indices into (N, 3)."""
    free, static = votes_free.astype(np.float32), votes_static.astype(np.float32)
    candidates = np.flatnonzero(
        (free >= settings.candidate_votes) & (free >= settings.candidate_ratio * static)
    )
    clusters = density_clusters(
        xyz[candidates],
        eps_m=settings.eps_m,
        vertical_share=settings.vertical_share,
        minimum_neighbours=settings.minimum_neighbours,
        minimum_points=settings.minimum_points,
    )
    return [candidates[cluster] for cluster in clusters]


def _boxes(
    rectangles: list[BevBox], members: list[IntArray], evidence: _Evidence, stands_m: float
) -> FloatArray:
    """Return (N, 7) boxes around the regions, down to the ground where they stand on it."""
    boxes = np.empty((len(members), 7))
    for i, (rectangle, m) in enumerate(zip(rectangles, members, strict=True)):
        y = evidence.cloud.xyz[m, 1].astype(np.float64)
        lowest = int(np.argmax(y))
        top, bottom = float(y.min()), float(y[lowest])
        above = float(evidence.heights_m[m[lowest]])
        if 0.0 < above <= stands_m:
            bottom += above
        boxes[i] = (
            rectangle.cx,
            (top + bottom) / 2,
            rectangle.cz,
            rectangle.length,
            rectangle.width,
            bottom - top,
            rectangle.yaw_rad,
        )
    return boxes
