"""Colours the hits of cast rays: solid noise, painted patterns, Lambert light and soft shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcrdata.datasets.textures import albedo
from tcrdata.geometry.intersections import (
    BOX,
    CONE,
    CYLINDER,
    PLANE,
    SPHERE,
    hit_shape,
    kernel,
    may_hit,
)
from tcrdata.geometry.raycasting import Primitives
from tcrdata.types import FloatArray, ImageArray, IntArray

GAMMA = 2.2


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
        """Return the numbers as a (6, 3) array for the kernels."""
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
        samples: rays a pixel in each direction, on a regular grid.
    """
    linear = _render(
        primitives.kinds,
        primitives.unit_T_world,
        primitives.spheres,
        primitives.half_sizes,
        materials,
        light.rows(),
        light.shadow_rays,
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


@kernel
def _normal(
    kind: int, A: FloatArray, half_size: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:
    # x, y, z: the hit in unit coordinates; a gradient there is turned back by A transposed.
    gx, gy, gz = 0.0, 0.0, 1.0
    if kind == SPHERE:
        gx, gy, gz = x, y, z
    elif kind == BOX:
        ax, ay, az = abs(x), abs(y), abs(z)
        if ax >= ay and ax >= az:
            gx, gz = math.copysign(1.0, x), 0.0
        elif ay >= az:
            gy, gz = math.copysign(1.0, y), 0.0
        else:
            gz = math.copysign(1.0, z)
    elif kind == CYLINDER:
        if x * x + y * y > z * z:
            gx, gy, gz = x, y, 0.0
        else:
            gz = math.copysign(1.0, z)
    elif kind == CONE:
        if z > -1.0 + 1e-6:
            gx, gy, gz = x, y, 0.25 * (1.0 - z)
        else:
            gz = -1.0
    elif half_size[2] > 0.0:
        k = 2.0 * math.pi / half_size[0]
        gx = -0.5 * half_size[2] * k * math.cos(k * x)
        gy = -0.5 * half_size[2] * 1.3 * k * math.cos(1.3 * k * y + 1.0)
    nx = A[0, 0] * gx + A[1, 0] * gy + A[2, 0] * gz
    ny = A[0, 1] * gx + A[1, 1] * gy + A[2, 1] * gz
    nz = A[0, 2] * gx + A[1, 2] * gy + A[2, 2] * gz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length


@kernel
def _lit_share(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    light: FloatArray,
    rays: int,
    phase: float,
    x: float,
    y: float,
    z: float,
) -> float:
    """Share of the light's disc that is seen from a point."""
    if rays == 0:
        return 1.0
    lit = 0
    for ray in range(rays):
        # A sunflower spiral spreads the rays evenly; the phase differs by sample of the pixel.
        radius = math.sqrt((ray + 0.5) / rays)
        angle = 2.399963 * ray + phase
        u, v = radius * math.cos(angle), radius * math.sin(angle)
        dx = light[0, 0] + u * light[1, 0] + v * light[2, 0]
        dy = light[0, 1] + u * light[1, 1] + v * light[2, 1]
        dz = light[0, 2] + u * light[1, 2] + v * light[2, 2]
        clear = True
        for p in range(len(kinds)):
            if kinds[p] == PLANE or not may_hit(spheres, p, x, y, z, dx, dy, dz, np.inf):
                continue
            if hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz) < np.inf:
                clear = False
                break
        lit += clear
    return lit / rays


@kernel
def _open_share(
    spheres: FloatArray, own: int, x: float, y: float, z: float, nx: float, ny: float, nz: float
) -> float:
    """Share of the surroundings' light that the other shapes leave, each taken for a ball."""
    closed = 0.0
    for p in range(len(spheres)):
        radius = 0.75 * spheres[p, 3]
        if p == own or radius == np.inf:
            continue
        cx, cy, cz = spheres[p, 0] - x, spheres[p, 1] - y, spheres[p, 2] - z
        distance2 = cx * cx + cy * cy + cz * cz
        if distance2 > 25.0 * radius * radius:
            continue
        facing = (nx * cx + ny * cy + nz * cz) / math.sqrt(distance2)
        closed += max(0.0, facing) * min(1.0, radius * radius / distance2)
    return 1.0 / (1.0 + 1.2 * closed)


@kernel
def _sky(light: FloatArray, dz: float, length: float) -> tuple[float, float, float]:
    up = math.sqrt(min(1.0, max(0.0, dz / length)))
    return (
        light[4, 0] + up * (light[5, 0] - light[4, 0]),
        light[4, 1] + up * (light[5, 1] - light[4, 1]),
        light[4, 2] + up * (light[5, 2] - light[4, 2]),
    )


@kernel
def _first_hit(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    origin: FloatArray,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, int]:
    best, hit = np.inf, -1
    for p in range(len(kinds)):
        if may_hit(spheres, p, origin[0], origin[1], origin[2], dx, dy, dz, best):
            t = hit_shape(
                kinds, unit_T_world, half_sizes, p, origin[0], origin[1], origin[2], dx, dy, dz
            )
            if t < best:
                best, hit = t, p
    return best, hit


@kernel
def _colour(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    materials: FloatArray,
    light: FloatArray,
    rays: int,
    phase: float,
    origin: FloatArray,
    dx: float,
    dy: float,
    dz: float,
    px: float,
) -> tuple[float, float, float]:
    """Linear RGB of what one ray sees; px is the ray's footprint at t = 1 in metres."""
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    sky = _sky(light, dz, length)
    t, p = _first_hit(kinds, unit_T_world, spheres, half_sizes, origin, dx, dy, dz)
    if p < 0:
        return sky
    x, y, z = origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz
    A = unit_T_world[p]
    ux = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + A[0, 3]
    uy = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + A[1, 3]
    uz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + A[2, 3]
    nx, ny, nz = _normal(kinds[p], A, half_sizes[p], ux, uy, uz)
    r, g, b = albedo(materials[p], kinds[p], half_sizes[p], ux, uy, uz, px * t)
    x, y, z = x + 1e-4 * nx, y + 1e-4 * ny, z + 1e-4 * nz
    direct = max(0.0, nx * light[0, 0] + ny * light[0, 1] + nz * light[0, 2])
    if direct > 0.0:
        direct *= _lit_share(kinds, unit_T_world, spheres, half_sizes, light, rays, phase, x, y, z)
    around = light[3, 1] * (0.65 + 0.35 * nz) * _open_share(spheres, p, x, y, z, nx, ny, nz)
    glint = 0.0
    if direct > 0.0 and materials[p, 5] > 0.0:
        hx, hy, hz = light[0, 0] - dx / length, light[0, 1] - dy / length, light[0, 2] - dz / length
        facing = (nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz)
        glint = materials[p, 5] * max(0.0, facing) ** 40 * direct
    level = light[3, 0] * direct + around
    near = math.exp(-((t * length / light[3, 2]) ** 2))
    return (
        near * (r * level + glint) + (1.0 - near) * sky[0],
        near * (g * level + glint) + (1.0 - near) * sky[1],
        near * (b * level + glint) + (1.0 - near) * sky[2],
    )


@kernel
def _render(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    materials: FloatArray,
    light: FloatArray,
    rays: int,
    origin: FloatArray,
    R: FloatArray,
    width: int,
    height: int,
    n: int,
) -> FloatArray:
    image = np.zeros((height, width, 3))
    px = math.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2 + R[2, 0] ** 2)
    for row in range(height):
        for column in range(width):
            for sample in range(n * n):
                u = column + (sample % n + 0.5) / n - 0.5
                v = row + (sample // n + 0.5) / n - 0.5
                dx = R[0, 0] * u + R[0, 1] * v + R[0, 2]
                dy = R[1, 0] * u + R[1, 1] * v + R[1, 2]
                dz = R[2, 0] * u + R[2, 1] * v + R[2, 2]
                colour = _colour(
                    kinds, unit_T_world, spheres, half_sizes, materials, light, rays,
                    1.57 * sample, origin, dx, dy, dz, px,
                )  # fmt: skip
                for channel in range(3):
                    image[row, column, channel] += colour[channel] / (n * n)
    return image


@kernel
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
        nx, ny, nz = _normal(kinds[p], A, half_sizes[p], ux, uy, uz)
        r, g, b = albedo(materials[p], kinds[p], half_sizes[p], ux, uy, uz, 0.02)
        brightness[i] = (r + g + b) / 3.0
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        cosines[i] = abs(nx * dx + ny * dy + nz * dz) / length
    return brightness, cosines
