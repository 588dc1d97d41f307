"""The rigid motion that most point displacements agree on: seeded RANSAC, then a refit.

Fits are by singular value decomposition (Kabsch 1976; Arun et al. 1987). Sums run in one thread
and in one order, so that the same input gives the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, FloatArray


class RigidFit(NamedTuple):
    """A rigid motion and what agrees with it.

    Attributes:
        to_T_from: (4, 4).
        inliers: (N,) displacements within the radius of the refitted motion.
        residual_m: root mean square distance of the inliers.
    """

    to_T_from: FloatArray
    inliers: BoolArray
    residual_m: float


def fit_rigid(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the (..., 4, 4) rigid motions that take start to end with the least squares.

    Args:
        start: (..., N, 3) points, metres, N at least 3.
        end: (..., N, 3) points, metres.
    """
    center_start, center_end = start.mean(axis=-2), end.mean(axis=-2)
    covariance = np.einsum(
        "...ni,...nj->...ij", start - center_start[..., None, :], end - center_end[..., None, :]
    )
    left, _, right = np.linalg.svd(covariance)
    # A reflection is turned into the nearest rotation along the weakest axis.
    signs = np.ones(covariance.shape[:-1])
    signs[..., 2] = np.sign(np.linalg.det(covariance_rotation(left, right)))
    rotation = np.einsum("...ji,...j,...kj->...ik", right, signs, left)
    motion = np.zeros((*covariance.shape[:-2], 4, 4))
    motion[..., :3, :3] = rotation
    motion[..., :3, 3] = center_end - np.einsum("...ij,...j->...i", rotation, center_start)
    motion[..., 3, 3] = 1.0
    return motion


def covariance_rotation(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the (..., 3, 3) orthogonal matrices `V U^T`, maybe reflections."""
    return np.asarray(np.einsum("...ji,...kj->...ik", right, left))


@compiled
def _count_inliers(
    motions: FloatArray, start: FloatArray, end: FloatArray, radius: float
) -> FloatArray:
    counts = np.zeros(len(motions), np.float64)
    for draw in range(len(motions)):
        m = motions[draw]
        for i in range(len(start)):
            x, y, z = start[i, 0], start[i, 1], start[i, 2]
            dx = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3] - end[i, 0]
            dy = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3] - end[i, 1]
            dz = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3] - end[i, 2]
            if dx * dx + dy * dy + dz * dz < radius * radius:
                counts[draw] += 1
    return counts


def distances(to_T_from: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return (N,) metres between moved (N, 3) starts and their ends."""
    moved = np.einsum("ij,nj->ni", to_T_from[:3, :3], start) + to_T_from[:3, 3]
    return np.asarray(np.sqrt(((moved - end) ** 2).sum(axis=1)))


def ransac_rigid(
    start: FloatArray,
    end: FloatArray,
    *,
    radius_m: float,
    draws: int,
    draw_size: int,
    scored: int,
    seed: tuple[int, ...],
) -> RigidFit | None:
    """Find the motion with the most inliers and refit it on them.

    Args:
        start: (N, 3) points, metres.
        end: (N, 3) where they went, metres.
        radius_m: a displacement within this of the motion is an inlier.
        draws: motions tried.
        draw_size: displacements a draw.
        scored: at most so many displacements, drawn once, rank the motions; all are refitted.
        seed: of the draws.

    Returns:
        None when there are fewer displacements, or inliers, than a draw takes.
    """
    if len(start) < draw_size:
        return None
    random = np.random.default_rng(seed)
    picked = random.integers(0, len(start), (draws, draw_size))
    motions = fit_rigid(start[picked], end[picked])
    judges = np.sort(random.permutation(len(start))[:scored])
    counts = _count_inliers(motions, start[judges], end[judges], radius_m)
    inliers = distances(motions[int(counts.argmax())], start, end) < radius_m
    if inliers.sum() < draw_size:
        return None
    motion = fit_rigid(start[inliers], end[inliers])
    apart = distances(motion, start, end)
    inliers = apart < radius_m
    residual = float(np.sqrt((apart[inliers] ** 2).mean())) if inliers.any() else float("nan")
    return RigidFit(motion, inliers, residual)
