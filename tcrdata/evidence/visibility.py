"""Visibility by ray casting: whether the rays that reach a proposal's box end in it.

A thing stops the rays that meet it; where they pass through to what is behind, nothing is there.
Every proposal of the first round and of this one, whatever its source, gets a confidence of module
`visibility`: of the rays of its own sweep that reach its box, the share that ends in it. Sources
whose own cue says nothing of motion get one of module `free_space`, too: what the rays of other
sweeps saw at the places of its points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.frame_proposals import EVIDENCE_ROUND, FrameProposals, frame_proposals
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching, error_rows
from tcrdata.evidence.proposal_columns import Columns
from tcrdata.evidence.range_images import LidarCells, sensor_grid
from tcrdata.evidence.ray_counts import ray_counts, rays_of
from tcrdata.types import CueInput, Dataset, FloatArray, Rows, Sensor

NEEDS: tuple[str, ...] = ("ground", "free_space", "detected_objects")
GIVES: tuple[str, ...] = ("confidences",)
NEEDS_IMAGES: bool = False

MODULE, MOTION_MODULE = "visibility", "free_space"
OF_MOTION = frozenset({"motion_3d", "motion_2d", "free_space", "track"})
"""Modules that say whether something moved."""

VOTES = ("votes_free_mean", "votes_static_mean")


@dataclass(frozen=True)
class Settings:
    """Which rays are asked; metres are multiplied by the sequence's metric scale.

    Attributes:
        core_share: of a box's length, width and height: rays are asked that meet the middle part,
            which an object surely fills.
        base_m: the lowest part of a box is no core, up to half of it: rays pass beneath a body.
        margin_m: a return this far outside of the box along its ray still is the box's.
        chunk_frames: frames an item of work.
    """

    core_share: float = 0.6
    base_m: float = 0.3
    margin_m: float = 0.3
    chunk_frames: int = 16


@dataclass(frozen=True)
class _Chunk:
    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: Settings
    items: tuple[FrameProposals, ...]


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `confidences` of module visibility, and of free_space where no cue spoke of motion."""
    speaking = _sources_of_motion(cue)
    chunks = (
        _Chunk(
            cue.dataset,
            cue.info.sensor,
            cue.info.metric_scale,
            cue.settings,
            tuple(frame_proposals(cue, frame, VOTES) for frame in frames),
        )
        for frames in chunked(cue.frames, cue.settings.chunk_frames)
    )
    for measured, errors in cue.parallel(_measure_chunk, chunks):
        for item, columns in measured:
            yield Rows("confidences", columns)
            if motion := _free_space(item, speaking):
                yield Rows("confidences", motion)
        yield from error_rows(errors)


def _sources_of_motion(cue: CueInput) -> frozenset[str]:
    """Return the sources of proposals that have a word on motion already."""
    found: set[str] = set()
    for number in sorted({EVIDENCE_ROUND, cue.round}):
        rows = cue.tables.read("confidences", columns=["source", "module"], round=number)
        pairs = rows.group_by(["source", "module"]).aggregate([]).to_pylist()
        found |= {pair["source"] for pair in pairs if pair["module"] in OF_MOTION}
    return frozenset(found)


def _measure_chunk(
    chunk: _Chunk,
) -> tuple[list[tuple[FrameProposals, Columns]], list[tuple[int, str]]]:
    measured: list[tuple[FrameProposals, Columns]] = []
    errors: list[tuple[int, str]] = []
    for item in chunk.items:
        if item.ground is None or not item.ids:
            continue
        try:
            measured.append((item, _visibility(chunk, item, item.ground)))
        except FrameError as error:
            errors.append((item.frame.frame, str(error)))
    return measured, errors


def _visibility(chunk: _Chunk, item: FrameProposals, ground: EncodedPoints) -> Columns:
    """Return the share of the rays that reach each box and end in it; NULL where none does."""
    own, scale = chunk.settings, chunk.metric_scale
    xyz = chunk.dataset.read_points(item.frame).xyz
    T = sensor_grid(item.frame, chunk.sensor, LidarCells()).sensor_T_level.astype(np.float64)
    rays = rays_of(xyz, decode_matching(ground, len(xyz)), -T[:, :3].T @ T[:, 3])
    cores = _cores(item.boxes, own.core_share, own.base_m * scale)
    stopped, passed = ray_counts(rays, item.boxes, cores, own.margin_m * scale)
    reached = (stopped + passed).tolist()
    shares = [s / r if r else None for s, r in zip(stopped.tolist(), reached, strict=True)]
    return item.confidences(MODULE, shares, list(map(float, reached)), "rays")


def _cores(boxes: FloatArray, share: float, base_m: float) -> FloatArray:
    """Return the middle parts of (N, 7) boxes without what lies low."""
    cores = boxes.copy()
    cores[:, 3:6] *= share
    low = np.minimum(base_m, boxes[:, 5] / 2)
    # y points down: a core ends above its box's low part.
    too_low = np.maximum(low - (boxes[:, 5] - cores[:, 5]) / 2, 0.0)
    cores[:, 1] -= too_low / 2
    cores[:, 5] -= too_low
    return cores


def _free_space(item: FrameProposals, speaking: frozenset[str]) -> Columns | None:
    """Return the share of free votes of the proposals of sources that say nothing of motion."""
    own = [i for i, source in enumerate(item.sources) if source not in speaking]
    if not own:
        return None
    votes = item.values[own].tolist()
    shares = [free / (free + static) if free + static > 0 else None for free, static in votes]
    # NaN stands for no points: it is no vote.
    free_votes = [None if np.isnan(free) else free for free, _ in votes]
    return item.confidences(MOTION_MODULE, shares, free_votes, "votes a point", own)
