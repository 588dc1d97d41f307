"""Casts rays at analytic shapes: exact hits, hidden pixels and surface normals.

Every shape is a unit shape under an affine map: the sphere |p| = 1, the box max|p| = 1, the
cylinder x^2 + y^2 = 1, |z| <= 1, the cone with its apex at z = 1 and its unit base at z = -1, and
the plane z = 0, seen from above. Axes are right-handed, z up; metres. A ray is
`origin + t * direction`; a direction need not have unit length, so t is depth where its forward
component is 1, and range where its length is 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tcrdata.geometry.intersections import (
    BOX,
    CONE,
    CYLINDER,
    PLANE,
    SPHERE,
    gather_candidates,
    hit_shape,
    may_hit,
)
from tcrdata.geometry.kernels import compiled
from tcrdata.types import FloatArray, IntArray

Shape = Literal["plane", "sphere", "box", "cylinder", "cone"]
KINDS: dict[str, int] = {
    "plane": PLANE,
    "sphere": SPHERE,
    "box": BOX,
    "cylinder": CYLINDER,
    "cone": CONE,
}
# Radius of the ball around each unit shape; a plane has none.
UNIT_RADII = (math.inf, 1.0, math.sqrt(3.0), math.sqrt(2.0), math.sqrt(2.0))
NOTHING = -1
# Rays that share one search for the shapes they may meet.
BUNDLE = 64


@dataclass(frozen=True)
class Primitives:
    """P shapes at one moment.

    Attributes:
        kinds: (P,) int64, values of `KINDS`.
        unit_T_world: (P, 3, 4) affine: world (m) to the unit shape.
        spheres: (P, 4) centre and radius (m) of a ball around each shape; infinite for planes.
        half_sizes: (P, 3) metres a unit; for a plane (wavelength, 0, amplitude) of its relief.
        owners: (P,) int64, the object that a shape is part of; -1 for the background. Shapes of one
            object are neighbours.
    """

    kinds: IntArray
    unit_T_world: FloatArray
    spheres: FloatArray
    half_sizes: FloatArray
    owners: IntArray

    def __len__(self) -> int:
        return len(self.kinds)

    def join(self, other: Primitives) -> Primitives:
        """Return these shapes followed by others."""
        return Primitives(
            np.concatenate([self.kinds, other.kinds]),
            np.concatenate([self.unit_T_world, other.unit_T_world]),
            np.concatenate([self.spheres, other.spheres]),
            np.concatenate([self.half_sizes, other.half_sizes]),
            np.concatenate([self.owners, other.owners]),
        )


def place(
    shapes: Sequence[Shape],
    half_sizes: Sequence[Sequence[float]],
    world_T_shape: ArrayLike,
    owners: Sequence[int],
) -> Primitives:
    """Place P shapes.

    Args:
        shapes: P names.
        half_sizes: (P, 3) metres along the shape's x, y and z: radii, half edges, half heights.
        world_T_shape: (P, 4, 4) rigid poses of the shapes' centres.
        owners: P object numbers, -1 for the background.
    """
    kinds = np.array([KINDS[shape] for shape in shapes], dtype=np.int64)
    sizes = np.asarray(half_sizes, dtype=np.float64).reshape(-1, 3)
    poses = np.asarray(world_T_shape, dtype=np.float64).reshape(-1, 4, 4)
    scales = np.where((kinds == PLANE)[:, None], 1.0, sizes)
    inverse_rotations = np.swapaxes(poses[:, :3, :3], 1, 2) / scales[:, :, None]
    shifts = -np.einsum("pij,pj->pi", inverse_rotations, poses[:, :3, 3])
    radii = np.array(
        [_ball_radius(int(kind), size) for kind, size in zip(kinds, sizes, strict=True)]
    )
    return Primitives(
        kinds=kinds,
        unit_T_world=np.concatenate([inverse_rotations, shifts[:, :, None]], axis=2),
        spheres=np.concatenate([poses[:, :3, 3], radii.reshape(-1, 1)], axis=1),
        half_sizes=sizes,
        owners=np.asarray(owners, dtype=np.int64).reshape(-1),
    )


def _ball_radius(kind: int, half_size: FloatArray) -> float:
    if kind == PLANE:
        return math.inf
    if kind == SPHERE:
        return float(half_size.max())
    if kind == BOX:
        return float(np.linalg.norm(half_size))
    return math.hypot(float(half_size[:2].max()), float(half_size[2]))


def cast(
    primitives: Primitives,
    origin: ArrayLike,
    directions: NDArray[np.floating],
    limit: float = math.inf,
) -> tuple[FloatArray, IntArray]:
    """Find the first shape along each ray.

    Args:
        primitives: P shapes.
        origin: (3,) metres, world, common to all rays.
        directions: (N, 3) world; fastest where neighbours point the same way.
        limit: the largest t that counts.

    Returns:
        (N,) t in lengths of the direction, inf where nothing is hit, and (N,) indices of shapes,
        -1 where nothing is hit.
    """
    return _cast(
        primitives.kinds,
        primitives.unit_T_world,
        primitives.spheres,
        primitives.half_sizes,
        np.asarray(origin, dtype=np.float64),
        np.ascontiguousarray(directions, dtype=np.float64),
        limit,
    )


def count_pixels(
    primitives: Primitives,
    origin: ArrayLike,
    world_R_pixel: ArrayLike,
    windows: NDArray[np.integer],
) -> tuple[IntArray, IntArray]:
    """Count the pixels of each object: those it shows, and those it would show alone.

    Args:
        primitives: P shapes, owned by objects 0 to M - 1.
        origin: (3,) the camera's centre, world.
        world_R_pixel: (3, 3) takes a homogeneous pixel (column, row, 1) to a world direction.
        windows: (M, 4) first column, first row, past the last column, past the last row to look at.

    Returns:
        (M,) visible pixels and (M,) pixels of the whole silhouette inside the window.
    """
    return _count_pixels(
        primitives.kinds,
        primitives.unit_T_world,
        primitives.spheres,
        primitives.half_sizes,
        primitives.owners,
        np.asarray(origin, dtype=np.float64),
        np.ascontiguousarray(world_R_pixel, dtype=np.float64),
        np.ascontiguousarray(windows, dtype=np.int64),
    )


@compiled
def _cast(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    origin: FloatArray,
    directions: FloatArray,
    limit: float,
) -> tuple[FloatArray, IntArray]:
    times = np.full(len(directions), np.inf)
    hits = np.full(len(directions), NOTHING, dtype=np.int64)
    found = np.empty(len(kinds), dtype=np.int64)
    x, y, z = origin[0], origin[1], origin[2]
    for first in range(0, len(directions), BUNDLE):
        bundle = directions[first : first + BUNDLE]
        count = gather_candidates(spheres, origin, bundle, limit, found)
        for i in range(len(bundle)):
            dx, dy, dz = bundle[i, 0], bundle[i, 1], bundle[i, 2]
            best = limit
            for c in range(count):
                p = found[c]
                if not may_hit(spheres, p, x, y, z, dx, dy, dz, best):
                    continue
                t = hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz, best)
                if t < best:
                    best = t
                    hits[first + i] = p
                    times[first + i] = t
    return times, hits


@compiled
def _count_pixels(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    owners: IntArray,
    origin: FloatArray,
    world_R_pixel: FloatArray,
    windows: IntArray,
) -> tuple[IntArray, IntArray]:
    visible = np.zeros(len(windows), dtype=np.int64)
    whole = np.zeros(len(windows), dtype=np.int64)
    found = np.empty(len(kinds), dtype=np.int64)
    x, y, z = origin[0], origin[1], origin[2]
    R = world_R_pixel
    for m in range(len(windows)):
        first, last = 0, 0
        for p in range(len(owners)):
            if owners[p] == m:
                if last == 0:
                    first = p
                last = p + 1
        count = _window_candidates(spheres, first, last, origin, R, windows[m], found)
        for row in range(windows[m, 1], windows[m, 3]):
            for column in range(windows[m, 0], windows[m, 2]):
                dx = R[0, 0] * column + R[0, 1] * row + R[0, 2]
                dy = R[1, 0] * column + R[1, 1] * row + R[1, 2]
                dz = R[2, 0] * column + R[2, 1] * row + R[2, 2]
                own = np.inf
                for p in range(first, last):
                    if not may_hit(spheres, p, x, y, z, dx, dy, dz, own):
                        continue
                    t = hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz, own)
                    own = min(own, t)
                if own == np.inf:
                    continue
                whole[m] += 1
                visible[m] += 1
                for c in range(count):
                    p = found[c]
                    if first <= p < last:
                        continue
                    if not may_hit(spheres, p, x, y, z, dx, dy, dz, own):
                        continue
                    t = hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz, own)
                    if t < own:
                        visible[m] -= 1
                        break
    return visible, whole


@compiled
def _window_candidates(
    spheres: FloatArray,
    first: int,
    last: int,
    origin: FloatArray,
    R: FloatArray,
    window: IntArray,
    found: IntArray,
) -> int:
    """Find the shapes seen in a window that are no farther than shapes first to last - 1."""
    corners = np.empty((4, 3))
    for corner in range(4):
        column, row = window[2 * (corner % 2)], window[1 + 2 * (corner // 2)]
        for axis in range(3):
            corners[corner, axis] = R[axis, 0] * column + R[axis, 1] * row + R[axis, 2]
    far = 0.0
    for p in range(first, last):
        away = 0.0
        for axis in range(3):
            away += (spheres[p, axis] - origin[axis]) ** 2
        far = max(far, math.sqrt(away) + spheres[p, 3])
    # A pixel's direction is at least 1 long, so t is at most the distance in metres.
    return int(gather_candidates(spheres, origin, corners, far, found))
