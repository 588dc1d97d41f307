"""Which points are ground, and how high each point is above it.

LiDAR: Patchwork++ (Lee et al., "Patchwork++: fast and robust ground segmentation solving partial
under-segmentation using 3D point cloud", IROS 2022), a fresh one for each sweep so that neither
order nor chunks matter. Depth: the plane `y = a x + b z + c` with the most inliers (RANSAC,
seeded), refitted by least squares.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcrdata.errors import EvidenceError, FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.heights import heights_above_cells, plane_heights
from tcrdata.evidence.point_rows import EncodedPoints, encoded, error_rows, point_rows
from tcrdata.geometry.transforms import inverse, transform_points
from tcrdata.types import (
    BoolArray,
    CueInput,
    Dataset,
    Float32Array,
    FloatArray,
    Frame,
    PointCloud,
    Rows,
    Sensor,
)

NEEDS: tuple[str, ...] = ()
GIVES: tuple[str, ...] = ("point_evidence",)
NEEDS_IMAGES: bool = False


@dataclass(frozen=True)
class Settings:
    """How ground is found; metres are multiplied by the sequence's metric scale.

    Attributes:
        sensor_height_m: LiDAR above the road.
        ground_margin_m: LiDAR: points this near the local ground level are ground too.
        cell_m: side of the cells that hold the local ground level.
        reach_m: half side of the square of cells.
        height_step_m: heights are rounded to multiples of this, a power of two.
        plane_draws: depth: RANSAC draws of three points.
        plane_sample: depth: points the draws are scored on.
        plane_margin_m: depth: inliers lie this near the plane.
        plane_slope_max: depth: steepest plane tried, rise over run in the level frame.
        seed: of the draws.
        minimum_points: a frame with fewer points has no ground.
        chunk_frames: frames an item of work.
    """

    sensor_height_m: float = 1.73
    ground_margin_m: float = 0.1
    cell_m: float = 2.0
    reach_m: float = 80.0
    height_step_m: float = 0.0078125
    plane_draws: int = 128
    plane_sample: int = 2000
    plane_margin_m: float = 0.2
    plane_slope_max: float = 0.3
    seed: int = 0
    minimum_points: int = 10
    chunk_frames: int = 8


@dataclass(frozen=True)
class _Chunk:
    dataset: Dataset
    frames: tuple[Frame, ...]
    sensor: Sensor
    settings: Settings


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `point_evidence` rows of the cues `ground` (bits) and `height_m` (f16).

    Raises:
        EvidenceError: the sequence has no usable frame: all that build on this cue stand still.
    """
    if not cue.frames:
        raise EvidenceError(
            f"{cue.info.dataset}/{cue.info.sequence}: none of its frames can be used; "
            "`tcrdata status` says why, frame by frame"
        )
    settings = _scaled(cue.settings, cue.info.metric_scale)
    items = (
        _Chunk(cue.dataset, frames, cue.info.sensor, settings)
        for frames in chunked(cue.frames, settings.chunk_frames)
    )
    for points, errors in cue.parallel(_measure_chunk, items):
        yield point_rows(points)
        yield from error_rows(errors)


def _scaled(settings: Settings, metric_scale: float) -> Settings:
    return replace(
        settings,
        sensor_height_m=settings.sensor_height_m * metric_scale,
        ground_margin_m=settings.ground_margin_m * metric_scale,
        cell_m=settings.cell_m * metric_scale,
        reach_m=settings.reach_m * metric_scale,
        height_step_m=2.0 ** np.floor(np.log2(settings.height_step_m * metric_scale)),
        plane_margin_m=settings.plane_margin_m * metric_scale,
    )


def _measure_chunk(chunk: _Chunk) -> tuple[list[EncodedPoints], list[tuple[int, str]]]:
    points: list[EncodedPoints] = []
    errors: list[tuple[int, str]] = []
    for frame in chunk.frames:
        try:
            cloud = chunk.dataset.read_points(frame)
        except FrameError as error:
            errors.append((frame.frame, str(error)))
            continue
        ground, heights = measure(cloud, frame, chunk.sensor, chunk.settings)
        points.append(encoded(frame.frame, "ground", "bits", ground))
        points.append(encoded(frame.frame, "height_m", "f16", _rounded(heights, chunk.settings)))
    return points, errors


def _rounded(heights: Float32Array, settings: Settings) -> Float32Array:
    """Drop digits that are noise: the stored array is a third as large."""
    step = np.float32(settings.height_step_m)
    return np.asarray(np.rint(heights / step) * step, dtype=np.float32)


def measure(
    cloud: PointCloud, frame: Frame, sensor: Sensor, settings: Settings
) -> tuple[BoolArray, Float32Array]:
    """Return (N,) whether each point is ground, and (N,) heights above the ground in metres."""
    if len(cloud) < settings.minimum_points:
        return np.zeros(len(cloud), bool), np.full(len(cloud), np.nan, np.float32)
    if sensor == "depth":
        plane = ground_plane(cloud.xyz, settings)
        heights = plane_heights(cloud.xyz, plane)
        return np.abs(heights) <= settings.plane_margin_m, heights
    ground = patchwork_ground(cloud, frame.sensor_matrix, settings)
    heights = heights_above_cells(
        cloud.xyz, ground, cell_m=settings.cell_m, reach_m=settings.reach_m
    )
    # Patchwork++ rejects whole patches where an object stands in one: the road there is ground.
    return ground | (np.abs(heights) <= settings.ground_margin_m), heights


def patchwork_ground(
    cloud: PointCloud, level_T_sensor: FloatArray, settings: Settings
) -> BoolArray:
    """Return (N,) whether Patchwork++ takes each point for ground."""
    points = np.empty((len(cloud), 4), np.float32)
    points[:, :3] = transform_points(inverse(level_T_sensor), cloud.xyz)
    points[:, 3] = cloud.reflectance
    estimator = _patchwork(settings)
    estimator.estimateGround(points)
    ground = np.zeros(len(cloud), bool)
    ground[np.asarray(estimator.getGroundIndices(), dtype=np.int64)] = True
    return ground


def _patchwork(settings: Settings) -> Any:
    import pypatchworkpp

    parameters = pypatchworkpp.Parameters()
    parameters.sensor_height = settings.sensor_height_m
    parameters.enable_RNR = False
    parameters.verbose = False
    with _stdout_silenced():
        return pypatchworkpp.patchworkpp(parameters)


@contextmanager
def _stdout_silenced() -> Iterator[None]:
    """Drop what a C++ constructor prints: it would end up in the command's own output."""
    kept = os.dup(1)
    void = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(void, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(void)
        os.close(kept)


def ground_plane(xyz: Float32Array, settings: Settings) -> FloatArray:
    """Return (a, b, c) of the plane `y = a x + b z + c` that holds the most points.

    Args:
        xyz: (N, 3) points, level frame, N >= 3.
        settings: metres already scaled.
    """
    random = np.random.default_rng(settings.seed)
    size = min(settings.plane_sample, len(xyz))
    sample = xyz[random.choice(len(xyz), size, replace=False)].astype(np.float64)
    design = np.column_stack([sample[:, 0], sample[:, 2], np.ones(size)])
    best, best_count = np.array([0.0, 0.0, float(np.median(sample[:, 1]))]), -1
    for triple in random.integers(0, size, (settings.plane_draws, 3)):
        if abs(np.linalg.det(design[triple])) < 1e-9:
            continue
        plane = np.linalg.solve(design[triple], sample[triple, 1])
        if np.hypot(plane[0], plane[1]) > settings.plane_slope_max:
            continue
        count = int((np.abs(design @ plane - sample[:, 1]) <= settings.plane_margin_m).sum())
        if count > best_count:
            best, best_count = plane, count
    return _refitted(xyz, best, settings.plane_margin_m)


def _refitted(xyz: Float32Array, plane: FloatArray, margin_m: float) -> FloatArray:
    design = np.column_stack([xyz[:, 0], xyz[:, 2], np.ones(len(xyz))]).astype(np.float64)
    for _ in range(2):
        near = np.abs(design @ plane - xyz[:, 1]) <= margin_m
        if near.sum() < 3:
            break
        plane = np.linalg.lstsq(design[near], xyz[near, 1].astype(np.float64), rcond=None)[0]
    return plane
