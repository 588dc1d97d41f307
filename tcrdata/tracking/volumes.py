"""Volumes of voxels: numbers and features written and read between the voxels' centres.

Places are in voxels from the centre of the first one. What lies outside of the centres is not
written, adds nothing, and reads as NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcrdata.geometry.kernels import compiled, reordered
from tcrdata.types import Float32Array, FloatArray

Weights = tuple[Any, Any, Any, Any, Any, Any, Any, Any]


def in_voxels(points: FloatArray | Float32Array, first: FloatArray, voxel_m: float) -> Float32Array:
    """Return (N, 3) places of points in voxels from the centre of the first, float32.

    Args:
        points: (N, 3) metres.
        first: (3,) the centre of the first voxel.
        voxel_m: side of a voxel.
    """
    return np.ascontiguousarray((points - first) / voxel_m, dtype=np.float32)


@compiled
def splat(volume: Float32Array, places: Float32Array, features: Float32Array) -> None:
    """Add (N, C) features to the eight voxels of (U, V, W, C) around each of (N, 3) places."""
    lines, layers = volume.shape[1] * volume.shape[2], volume.shape[2]
    flat = volume.reshape(-1, volume.shape[3])
    for i in range(len(places)):
        a, b, d = places[i, 0], places[i, 1], places[i, 2]
        if not _inside(a, b, d, volume.shape):
            continue
        u, v, w = int(a), int(b), int(d)
        weights = _weights(a - u, b - v, d - w)
        for k in range(8):
            n = (u + (k >> 2)) * lines + (v + ((k >> 1) & 1)) * layers + w + (k & 1)
            for c in range(volume.shape[3]):
                flat[n, c] += weights[k] * features[i, c]


@compiled
def samples(volume: Float32Array, places: Float32Array) -> FloatArray:
    """Return (N,) numbers of (U, V, W) at (N, 3) places: trilinear; NaN outside."""
    result = np.full(len(places), np.nan)
    for i in range(len(places)):
        a, b, d = places[i, 0], places[i, 1], places[i, 2]
        if not _inside(a, b, d, volume.shape):
            continue
        u, v, w = int(a), int(b), int(d)
        weights = _weights(a - u, b - v, d - w)
        total = 0.0
        for k in range(8):
            total += weights[k] * volume[u + (k >> 2), v + ((k >> 1) & 1), w + (k & 1)]
        result[i] = total
    return result


@compiled
def poses_in_voxels(best: FloatArray, offsets: FloatArray, voxels_a_metre: float) -> Float32Array:
    """Return (P, 4) poses in voxels and radians: (4,) metres and radians, each of (P, 4) added."""
    poses = np.empty((len(offsets), 4), np.float32)
    for h in range(len(offsets)):
        for i in range(3):
            poses[h, i] = (best[i] + offsets[h, i]) * voxels_a_metre
        poses[h, 3] = best[3] + offsets[h, 3]
    return poses


@compiled
def best_pose(
    scores: FloatArray, best: FloatArray, offsets: FloatArray, cost: float, arm: float
) -> int:
    """Return the number of the best of (P,) scores, less what the way there costs.

    Args:
        scores: of the poses.
        best: (4,) along, down, across in metres, and turn.
        offsets: (P, 4) from there.
        cost: of a metre.
        arm: metres a radian.
    """
    found, highest = 0, -np.inf
    for h in range(len(offsets)):
        a, b = abs(best[0] + offsets[h, 0]), abs(best[1] + offsets[h, 1])
        way = a + b + abs(best[2] + offsets[h, 2]) + arm * abs(best[3] + offsets[h, 3])
        score = scores[h] - cost * way
        if score > highest:
            found, highest = h, score
    return found


@reordered
def correlations(
    volume: Float32Array,
    places: Float32Array,
    features: Float32Array,
    centre: Float32Array,
    poses: Float32Array,
) -> FloatArray:
    """Return how well features fit a volume in each pose: `sum_i f_i . V(pose^-1 x_i)`, trilinear.

    Args:
        volume: (U, V, W, C).
        places: (N, 3) of the features, in voxels.
        features: (N, C).
        centre: (3,) about which a pose turns, in voxels.
        poses: (P, 4) shift along the three axes in voxels, and turn about the second in radians.
    """
    lines, layers = volume.shape[1] * volume.shape[2], volume.shape[2]
    flat = volume.reshape(-1, volume.shape[3])
    result = np.zeros(len(poses))
    for h in range(len(poses)):
        c, s = np.cos(poses[h, 3]), np.sin(poses[h, 3])
        total = np.float32(0)
        for i in range(len(places)):
            a, b, d = _shifted(places[i], centre, poses[h], c, s)
            if not _inside(a, b, d, volume.shape):
                continue
            u, v, w = int(a), int(b), int(d)
            w0, w1, w2, w3, w4, w5, w6, w7 = _weights(a - u, b - v, d - w)
            n = u * lines + v * layers + w
            # Written out: the compiler then takes several channels at once.
            for e in range(features.shape[1]):
                total += features[i, e] * (
                    w0 * flat[n, e]
                    + w1 * flat[n + 1, e]
                    + w2 * flat[n + layers, e]
                    + w3 * flat[n + layers + 1, e]
                    + w4 * flat[n + lines, e]
                    + w5 * flat[n + lines + 1, e]
                    + w6 * flat[n + lines + layers, e]
                    + w7 * flat[n + lines + layers + 1, e]
                )
        result[h] = total
    return result


@reordered
def rough_correlations(
    volume: Float32Array,
    places: Float32Array,
    features: Float32Array,
    centre: Float32Array,
    poses: Float32Array,
) -> FloatArray:
    """Return the same of the voxel that is nearest to each place: eight times as fast."""
    lines, layers = volume.shape[1] * volume.shape[2], volume.shape[2]
    flat = volume.reshape(-1, volume.shape[3])
    half = np.float32(0.5)
    result = np.zeros(len(poses))
    for h in range(len(poses)):
        c, s = np.cos(poses[h, 3]), np.sin(poses[h, 3])
        total = np.float32(0)
        for i in range(len(places)):
            a, b, d = _shifted(places[i], centre, poses[h], c, s)
            if not _inside(a, b, d, volume.shape):
                continue
            n = int(a + half) * lines + int(b + half) * layers + int(d + half)
            for e in range(features.shape[1]):
                total += features[i, e] * flat[n, e]
        result[h] = total
    return result


@reordered
def _shifted(place: Any, centre: Any, pose: Any, c: Any, s: Any) -> tuple[Any, Any, Any]:
    """Return where a place lies in the axes of a pose."""
    x, z = place[0] - centre[0] - pose[0], place[2] - centre[2] - pose[2]
    return centre[0] + c * x - s * z, place[1] - pose[1], centre[2] + s * x + c * z


@reordered
def _inside(a: Any, b: Any, d: Any, shape: tuple[int, ...]) -> bool:
    """Whether a place has voxel centres on all sides."""
    if a < 0 or b < 0 or d < 0:
        return False
    return bool(a < shape[0] - 1 and b < shape[1] - 1 and d < shape[2] - 1)


@reordered
def _weights(a: Any, b: Any, d: Any) -> Weights:
    """Return the shares of the eight voxels around, the last axis first."""
    one = np.float32(1)
    a, b, d = np.float32(a), np.float32(b), np.float32(d)
    p, q, r = one - a, one - b, one - d
    return p * q * r, p * q * d, p * b * r, p * b * d, a * q * r, a * q * d, a * b * r, a * b * d
