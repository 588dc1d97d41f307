"""Egomotion from the points alone, forward and backward in time as two independent estimates.

LiDAR: KISS-ICP on the points that are no ground. Depth: registration to keyframes. Both run over
the sequence in order, and once more in reverse order; a link's cycle error compares the two, and
its alignment lays the sweep on the one 10 frames later: consistency is not truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.depth_path import DepthPath
from tcrdata.evidence.lidar_path import LidarPath
from tcrdata.evidence.odometry_checks import CheckSettings, Link, checked
from tcrdata.evidence.point_rows import (
    EncodedPoints,
    decode_matching,
    error_rows,
    read_encoded,
)
from tcrdata.evidence.reach import solid_within
from tcrdata.geometry.transforms import inverse
from tcrdata.types import (
    CueInput,
    Dataset,
    Float32Array,
    FloatArray,
    Frame,
    PointCloud,
    Rows,
    Sensor,
)

NEEDS: tuple[str, ...] = ("ground",)
GIVES: tuple[str, ...] = ("egomotions",)
NEEDS_IMAGES: bool = False


@dataclass(frozen=True)
class Settings:
    """How egomotion is estimated; metres are multiplied by the sequence's metric scale.

    Attributes:
        nearest_m: LiDAR: nearer points are not used (the vehicle itself).
        furthest_m: LiDAR: farther points are not used.
        voxel_m: LiDAR: side of the map's voxels.
        voxel_points: LiDAR: most points a voxel of the map keeps.
        convergence: LiDAR: registration ends with a smaller step (m, rad).
        first_step_m: LiDAR: a drive may begin at this speed, m a sweep, or any lower one.
        first_spacing_m: LiDAR: the first steps that are tried lie this far apart.
        depth_voxel_m: depth: frames are thinned to one point a voxel.
        depth_gate_m: depth: points farther from the keyframe do not count.
        depth_support_share: depth: a motion is believed when this share of the points agrees
            with it in addition to those that agree with none.
        depth_overlap_share: depth: fewer points with a partner make a new keyframe.
        minimum_points: frames with fewer usable points are passed over.
        gap_s: frames farther apart in time are not linked.
        alignment_frames: the alignment is measured so many frames later.
        alignment_radius_m: a neighbour this near counts.
        alignment_points: most points asked for a neighbour.
        chunk_frames: most frames an item of the checks.
    """

    nearest_m: float = 3.5
    furthest_m: float = 80.0
    voxel_m: float = 1.0
    voxel_points: int = 10
    convergence: float = 0.0005
    first_step_m: float = 4.5
    first_spacing_m: float = 0.5
    depth_voxel_m: float = 0.5
    depth_gate_m: float = 1.0
    depth_support_share: float = 0.02
    depth_overlap_share: float = 0.7
    minimum_points: int = 10
    gap_s: float = 1.0
    alignment_frames: int = 10
    alignment_radius_m: float = 0.15
    alignment_points: int = 4000
    chunk_frames: int = 50


@dataclass(frozen=True)
class _Direction:
    """The frames in the order in which one estimator sees them."""

    dataset: Dataset
    sensor: Sensor
    settings: Settings
    frames: tuple[Frame, ...]
    ground: dict[int, EncodedPoints]


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield rows of `egomotions` with method odometry, one a pair of consecutive usable frames."""
    settings = _scaled(cue.settings, cue.info.metric_scale)
    ground = _read_ground(cue)
    onward, back = (
        _Direction(cue.dataset, cue.info.sensor, settings, frames, ground)
        for frames in (cue.frames, cue.frames[::-1])
    )
    (forward, errors), (backward, errors_back) = cue.parallel(_estimate, [onward, back])
    yield from error_rows(sorted({**dict(errors_back), **dict(errors)}.items()))
    yield from checked(cue, _links(forward, backward), ground, _checks(settings))


def _scaled(settings: Settings, metric_scale: float) -> Settings:
    names = (
        "nearest_m", "furthest_m", "voxel_m", "first_step_m", "first_spacing_m",
        "depth_voxel_m", "depth_gate_m", "alignment_radius_m",
    )  # fmt: skip
    return replace(settings, **{name: getattr(settings, name) * metric_scale for name in names})


def _read_ground(cue: CueInput) -> dict[int, EncodedPoints]:
    rows = (read_encoded(cue.tables, frame.frame, "ground") for frame in cue.frames)
    return {row.frame: row for row in rows if row is not None}


def _estimate(
    direction: _Direction,
) -> tuple[list[tuple[int, int, FloatArray]], list[tuple[int, str]]]:
    """Return the motions (a, b, b_T_a) between neighbours in order, and frames that failed."""
    motions: list[tuple[int, int, FloatArray]] = []
    errors: list[tuple[int, str]] = []
    path, before, before_ns, usual_ns = _new_path(direction), None, 0, 0
    world_T_before = np.eye(4)
    for frame in direction.frames:
        try:
            cloud = direction.dataset.read_points(frame)
        except FrameError as error:
            errors.append((frame.frame, str(error)))
            continue
        xyz = _usable(direction, frame, cloud)
        if len(xyz) < direction.settings.minimum_points:
            continue
        step_ns = abs(frame.timestamp_ns - before_ns)
        if before is not None and step_ns > direction.settings.gap_s * 1e9:
            path, before, usual_ns = _new_path(direction), None, 0
        world_T_level = path.add(xyz, step_ns / usual_ns if usual_ns else 1.0)
        if before is not None:
            motions.append((before, frame.frame, inverse(world_T_level) @ world_T_before))
            usual_ns = step_ns
        before, before_ns, world_T_before = frame.frame, frame.timestamp_ns, world_T_level
    return motions, errors


def _new_path(direction: _Direction) -> LidarPath | DepthPath:
    settings = direction.settings
    if direction.sensor == "lidar":
        return LidarPath(
            furthest_m=settings.furthest_m,
            voxel_m=settings.voxel_m,
            voxel_points=settings.voxel_points,
            convergence=settings.convergence,
            first_step_m=settings.first_step_m,
            first_spacing_m=settings.first_spacing_m,
        )
    return DepthPath(
        voxel_m=settings.depth_voxel_m,
        gate_m=settings.depth_gate_m,
        support_share=settings.depth_support_share,
        overlap_share=settings.depth_overlap_share,
    )


def _usable(direction: _Direction, frame: Frame, cloud: PointCloud) -> Float32Array:
    """Return the points to register: without ground for LiDAR, all for depth.

    A table carries most of what a depth image knows of height and tilt.
    """
    if direction.sensor == "depth":
        return cloud.xyz
    settings = direction.settings
    ground = np.zeros(len(cloud), np.bool_)
    if frame.frame in direction.ground:
        ground = decode_matching(direction.ground[frame.frame], len(cloud))
    sensor = frame.sensor_matrix[:3, 3]
    kept = solid_within(cloud.xyz, ground, sensor, settings.nearest_m, settings.furthest_m)
    return cloud.xyz.take(kept, axis=0)


def _links(
    forward: list[tuple[int, int, FloatArray]], backward: list[tuple[int, int, FloatArray]]
) -> list[Link]:
    back = {(to, start): motion for start, to, motion in backward}
    return [
        Link(start, to, motion, back[start, to])
        for start, to, motion in forward
        if (start, to) in back
    ]


def _checks(settings: Settings) -> CheckSettings:
    return CheckSettings(
        settings.alignment_frames,
        settings.alignment_radius_m,
        settings.alignment_points,
        settings.chunk_frames,
    )
