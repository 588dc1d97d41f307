"""Colours the hits of cast rays: solid noise, painted patterns, Lambert light and soft shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcrdata.datasets.lighting import (
    gather_shadowers,
    sky_colour,
    surface_colour,
    surface_normal,
)
from tcrdata.datasets.rays import add, aim, average, norm, reach
from tcrdata.datasets.textures import albedo
from tcrdata.geometry.intersections import gather_candidates, hit_shape, may_hit
from tcrdata.geometry.kernels import compiled
from tcrdata.geometry.raycasting import Primitives
from tcrdata.types import FloatArray, ImageArray, IntArray

GAMMA = 2.2
# Pixels of a row that share one search for the shapes that they see and that shade them.
STRIP = 16


@dataclass(frozen=True)
class Light:
    """The sun or lamp and the sky around it.

    Attributes:
        direction: towards the light, world, unit length.
        spread: radius of the light seen from a point, as a tangent: how soft shadows are.
        strength: of the direct light, linear.
        ambient: of the light from all around, linear.
        horizon: linear RGB of the sky at the horizon, into which far surfaces fade.
        zenith: linear RGB of the sky overhead.
        haze_m: distance at which a surface has faded to 1 - 1/e.
        shadow_rays: per sample; 0 for none.
        closeness: whether near shapes take away some of the ambient light.
    """

    direction: tuple[float, float, float]
    spread: float
    strength: float
    ambient: float
    horizon: tuple[float, float, float]
    zenith: tuple[float, float, float]
    haze_m: float
    shadow_rays: int = 4
    closeness: bool = True

    def rows(self) -> FloatArray:
        """Return the numbers as a (7, 3) array for the kernels."""
        first = np.asarray(self.direction, dtype=np.float64)
        first /= np.linalg.norm(first)
        side = np.cross(first, [0.31, 0.87, 0.38])
        side /= np.linalg.norm(side)
        return np.array(
            [
                first,
                side * self.spread,
                np.cross(first, side) * self.spread,
                (self.strength, self.ambient, self.haze_m),
                self.horizon,
                self.zenith,
                (self.shadow_rays, self.closeness, self.spread),
            ]
        )


def render(
    primitives: Primitives,
    materials: FloatArray,
    light: Light,
    origin: FloatArray,
    world_R_pixel: FloatArray,
    size_px: tuple[int, int],
    samples: int = 2,
) -> ImageArray:
    """Return the (H, W, 3) RGB image of the shapes.

    Args:
        primitives: P shapes.
        materials: (P, 10), see `material_rows`.
        light: the light.
        origin: (3,) the camera's centre, world (m).
        world_R_pixel: (3, 3) takes (column, row, 1) to a world direction of forward length 1.
        size_px: width and height.
        samples: rays a pixel in each direction, on a regular grid; where all of them see one
            smooth surface, it is lit once.
    """
    linear = _render(
        primitives.kinds,
        primitives.unit_T_world,
        primitives.spheres,
        primitives.half_sizes,
        materials,
        light.rows(),
        np.asarray(origin, dtype=np.float64),
        np.ascontiguousarray(world_R_pixel),
        size_px[0],
        size_px[1],
        samples,
    )
    return np.rint(255.0 * np.clip(linear, 0.0, 1.0) ** (1.0 / GAMMA)).astype(np.uint8)


def inspect_hits(
    primitives: Primitives,
    materials: FloatArray,
    origin: FloatArray,
    directions: FloatArray,
    times: FloatArray,
    hits: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Return (N,) linear brightness and (N,) cosines of incidence of the hits; 0 without one."""
    return _inspect(
        primitives.kinds,
        primitives.unit_T_world,
        primitives.half_sizes,
        materials,
        origin,
        directions,
        times,
        hits,
    )


@compiled
def _render(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    materials: FloatArray,
    light: FloatArray,
    origin: FloatArray,
    R: FloatArray,
    width: int,
    height: int,
    n: int,
) -> FloatArray:
    image = np.zeros((height, width, 3))
    seen, shading = np.empty_like(kinds), np.empty_like(kinds)
    rays, points = np.empty((STRIP * n * n, 3)), np.empty((STRIP * n * n, 3))
    times, hits = np.empty(STRIP * n * n), np.empty(STRIP * n * n, dtype=np.int64)
    footprint = norm(R[:, 0])
    for row in range(height):
        for first in range(0, width, STRIP):
            count = min(STRIP, width - first) * n * n
            aim(R, first, row, n, rays[:count])
            found = gather_candidates(spheres, origin, rays[:count], np.inf, seen)
            for i in range(count):
                times[i], hits[i] = _first_hit(
                    kinds, unit_T_world, spheres, half_sizes, seen[:found], origin, rays[i]
                )
                reach(points[i], origin, times[i], rays[i])
            casters = gather_shadowers(spheres, light, points[:count], hits, shading)
            for pixel in range(0, count, n * n):
                step = 1
                # Where one sample in the middle says as much as all, it is lit alone.
                if n > 1 and _is_plain(kinds, unit_T_world, half_sizes, points, hits, pixel, n * n):
                    step = n * n
                    average(rays, pixel, step)
                    times[pixel], hits[pixel] = _first_hit(
                        kinds, unit_T_world, spheres, half_sizes, seen[:found], origin, rays[pixel]
                    )
                    reach(points[pixel], origin, times[pixel], rays[pixel])
                for i in range(pixel, pixel + n * n, step):
                    length = norm(rays[i])
                    colour = sky_colour(light, rays[i, 2], length)
                    if hits[i] >= 0:
                        colour = surface_colour(
                            kinds, unit_T_world, spheres, half_sizes, materials,
                            shading[:casters], light, 1.57 * (i - pixel), hits[i], points[i],
                            rays[i] / length, times[i] * length, times[i] * footprint,
                        )  # fmt: skip
                    add(image[row, first + pixel // (n * n)], colour, step / (n * n))
    return image


@compiled
def _is_plain(
    kinds: IntArray,
    unit_T_world: FloatArray,
    half_sizes: FloatArray,
    points: FloatArray,
    hits: IntArray,
    first: int,
    count: int,
) -> bool:
    """Tell whether the samples of a pixel see one smooth surface, or the sky alone."""
    p = hits[first]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(first, first + count):
        if hits[i] != p:
            return False
        if p < 0:
            continue
        at = points[i]
        A = unit_T_world[p]
        nx, ny, nz = surface_normal(
            kinds[p],
            A,
            half_sizes[p],
            A[0, 0] * at[0] + A[0, 1] * at[1] + A[0, 2] * at[2] + A[0, 3],
            A[1, 0] * at[0] + A[1, 1] * at[1] + A[1, 2] * at[2] + A[1, 3],
            A[2, 0] * at[0] + A[2, 1] * at[1] + A[2, 2] * at[2] + A[2, 3],
        )
        x, y, z = x + nx, y + ny, z + nz
    return p < 0 or x * x + y * y + z * z > (0.99 * count) ** 2


@compiled
def _first_hit(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    candidates: IntArray,
    origin: FloatArray,
    ray: FloatArray,
) -> tuple[float, int]:
    best, hit = np.inf, -1
    x, y, z, dx, dy, dz = origin[0], origin[1], origin[2], ray[0], ray[1], ray[2]
    for p in candidates:
        if may_hit(spheres, p, x, y, z, dx, dy, dz, best):
            t = hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz, best)
            if t < best:
                best, hit = t, p
    return best, hit


@compiled
def _inspect(
    kinds: IntArray,
    unit_T_world: FloatArray,
    half_sizes: FloatArray,
    materials: FloatArray,
    origin: FloatArray,
    directions: FloatArray,
    times: FloatArray,
    hits: IntArray,
) -> tuple[FloatArray, FloatArray]:
    brightness, cosines = np.zeros(len(hits)), np.zeros(len(hits))
    for i in range(len(hits)):
        p = hits[i]
        if p < 0:
            continue
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        x, y, z = (
            origin[0] + times[i] * dx,
            origin[1] + times[i] * dy,
            origin[2] + times[i] * dz,
        )
        A = unit_T_world[p]
        ux = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + A[0, 3]
        uy = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + A[1, 3]
        uz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + A[2, 3]
        nx, ny, nz = surface_normal(kinds[p], A, half_sizes[p], ux, uy, uz)
        r, g, b = albedo(materials[p], kinds[p], half_sizes[p], ux, uy, uz, 0.02)
        brightness[i] = (r + g + b) / 3.0
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        cosines[i] = abs(nx * dx + ny * dy + nz * dz) / length
    return brightness, cosines
