"""Egomotion from flow: RANSAC over the displacements of 3D points, forward and backward alike.

Forward comes from the forward flow, backward from the backward flow, each on its own, so that
`max |backward(forward(x)) - x|` over the sweep tests both (eq. 6, 7). Nothing is gated here.

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), section 3.2, and its released code
(512 draws of 8 points, inlier radius 0.25 m, refit on the inliers, points beyond 1 m).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.alignment import cycle_error
from tcrdata.evidence.chain_alignment import alignments
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.point_flow import PixelIndex, ends, pixel_index
from tcrdata.evidence.point_rows import error_rows
from tcrdata.evidence.poses import chain
from tcrdata.evidence.rigid_ransac import RigidFit, ransac_rigid
from tcrdata.evidence.stored_flow import CycleTest, Pair, StoredFlow, image_pairs, read_flow
from tcrdata.geometry.transforms import rotation_angle
from tcrdata.types import CueInput, Dataset, Float32Array, Rows

NEEDS: tuple[str, ...] = ("flow", "ground")
GIVES: tuple[str, ...] = ("egomotions",)
NEEDS_IMAGES: bool = True
METHOD = "flow_ransac"
_NOT_ALIGNED = {"alignment_share": None, "alignment_frames": None}


@dataclass(frozen=True)
class Settings:
    """How the rigid motion is estimated. Metres are multiplied by the sequence's metric scale.

    Attributes:
        cycle_test: flows that take part: those that pass the paper's or the release's test, or
            all (`none`). The release's is stricter, one to one, and its motions align better:
            preset `paper` takes them too.
        inlier_radius_m: a displacement within this of the motion agrees with it.
        draws: motions tried.
        draw_size: displacements a draw.
        scored_flows: at most so many displacements rank the motions; all of them refit the best.
        near_m: points at a depth of at most this take no part.
        seed: of the draws; the frame's number is mixed in.
        alignment_frames: the alignment is measured so many frames later.
        alignment_radius_m: a neighbour this near counts.
        alignment_points: at most so many points are carried.
        pairs_per_task: frame pairs a worker takes at once.
    """

    cycle_test: CycleTest = "release"
    inlier_radius_m: float = 0.25
    draws: int = 512
    draw_size: int = 8
    scored_flows: int = 2000
    near_m: float = 1.0
    seed: int = 125
    alignment_frames: int = 10
    alignment_radius_m: float = 0.15
    alignment_points: int = 4000
    pairs_per_task: int = 8


@dataclass(frozen=True)
class _PairFlows:
    pair: Pair
    forward: StoredFlow
    backward: StoredFlow


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    flows: tuple[_PairFlows, ...]
    settings: Settings
    metric_scale: float


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `egomotions`: one row a pair of consecutive frames that have flow."""
    rows: list[dict[str, Any]] = []
    for measured, errors in cue.parallel(_measure_task, _tasks(cue)):
        rows += measured
        yield from error_rows(errors)
    if rows:
        aligned = _alignments(cue, rows)
        rows = [row | aligned.get(row["frame"], _NOT_ALIGNED) for row in rows]
        yield Rows("egomotions", {name: [row[name] for row in rows] for name in rows[0]})


def _tasks(cue: CueInput) -> Iterator[_Task]:
    settings: Settings = cue.settings
    for part in chunked(image_pairs(cue.frames), settings.pairs_per_task):
        yield _Task(cue.dataset, _with_flows(cue, part), settings, cue.info.metric_scale)


def _alignments(cue: CueInput, rows: list[dict[str, Any]]) -> dict[int, dict[str, Any]]:
    settings: Settings = cue.settings
    poses = chain([(row["frame"], row["frame_to"], row["to_T_from"]) for row in rows])
    measured = alignments(
        cue,
        poses,
        frames_later=settings.alignment_frames,
        radius_m=settings.alignment_radius_m * cue.info.metric_scale,
        points=settings.alignment_points,
        frames_per_task=settings.pairs_per_task,
    )
    return {
        found.frame: {"alignment_share": found.share, "alignment_frames": found.frames_later}
        for found in measured
    }


def _with_flows(cue: CueInput, pairs: tuple[Pair, ...]) -> tuple[_PairFlows, ...]:
    found = []
    for pair in pairs:
        forward = read_flow(cue.tables, pair.first, pair.second)
        backward = read_flow(cue.tables, pair.second, pair.first)
        if forward is not None and backward is not None:
            found.append(_PairFlows(pair, forward, backward))
    return tuple(found)


def _measure_task(task: _Task) -> tuple[list[dict[str, Any]], list[tuple[int, str]]]:
    rows: list[dict[str, Any]] = []
    errors: list[tuple[int, str]] = []
    known: dict[int, PixelIndex] = {}
    near_m = task.settings.near_m * task.metric_scale
    for flows in task.flows:
        size = (flows.forward.width_px, flows.forward.height_px)
        try:
            first, second = (
                known.get(frame.frame) or pixel_index(task.dataset, frame, *size, near_m)
                for frame in flows.pair
            )
        except FrameError as error:
            errors.append((flows.pair.first.frame, str(error)))
            continue
        known = {flows.pair.second.frame: second}
        seed = (task.settings.seed, flows.pair.first.frame)
        forward = estimate(first, second, flows.forward, task, (*seed, 0))
        backward = estimate(second, first, flows.backward, task, (*seed, 1))
        rows.append(egomotion_row(flows.pair, first.xyz, forward, backward))
    return rows, errors


@dataclass(frozen=True)
class Estimate:
    """The point flows of one direction and the motion found in them, if any."""

    tried: int
    fit: RigidFit | None


def estimate(
    start: PixelIndex, end: PixelIndex, flow: StoredFlow, task: _Task, seed: tuple[int, ...]
) -> Estimate:
    """Find the rigid motion of one direction.

    Args:
        start: points of the frame where the flow starts.
        end: points of the frame where it ends.
        flow: from one to the other.
        task: settings and scale.
        seed: of the draws.
    """
    settings = task.settings
    found = ends(start, end, flow.decode())
    kept = (found >= 0) & flow.passes(settings.cycle_test)[start.rows, start.columns]
    from_xyz = start.xyz[start.points[kept]].astype(np.float64)
    to_xyz = end.xyz[found[kept]].astype(np.float64)
    fit = ransac_rigid(
        from_xyz,
        to_xyz,
        radius_m=settings.inlier_radius_m * task.metric_scale,
        draws=settings.draws,
        draw_size=settings.draw_size,
        scored=settings.scored_flows,
        seed=seed,
    )
    return Estimate(len(from_xyz), fit)


def egomotion_row(
    pair: Pair, xyz: Float32Array, forward: Estimate, backward: Estimate
) -> dict[str, Any]:
    """Return a row of `egomotions`; what could not be estimated is None."""
    there, back = forward.fit, backward.fit
    inliers = int(there.inliers.sum()) if there else 0
    return {
        "frame": pair.first.frame,
        "frame_to": pair.second.frame,
        "method": METHOD,
        "to_T_from": there.to_T_from.ravel().tolist() if there else None,
        "from_T_to": back.to_T_from.ravel().tolist() if back else None,
        "inliers": inliers,
        "inlier_share": inliers / forward.tried if forward.tried else None,
        "residual_m": there.residual_m if there else None,
        "translation_m": float(np.linalg.norm(there.to_T_from[:3, 3])) if there else None,
        "rotation_rad": rotation_angle(there.to_T_from) if there else None,
        "cycle_error_m": (
            cycle_error(xyz, there.to_T_from, back.to_T_from) if there and back else None
        ),
    }
