"""Compiled light on a surface: normals, soft shadows, closeness, highlights and haze.

`light` is the (7, 3) array of `shading.Light.rows`.
"""

from __future__ import annotations

import math

import numpy as np

from tcrdata.datasets.textures import albedo
from tcrdata.geometry.intersections import (
    BOX,
    CONE,
    CYLINDER,
    SPHERE,
    hit_shape,
    may_hit,
)
from tcrdata.geometry.kernels import compiled
from tcrdata.types import FloatArray, IntArray


@compiled
def surface_normal(
    kind: int, A: FloatArray, half_size: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the unit normal in the world at a point of the unit shape."""
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


@compiled
def gather_shadowers(
    spheres: FloatArray, light: FloatArray, points: FloatArray, hits: IntArray, found: IntArray
) -> int:
    """Find the shapes that may stand between the light and those of (K, 3) points that are hits."""
    cx, cy, cz, count = 0.0, 0.0, 0.0, 0
    for i in range(len(points)):
        if hits[i] >= 0:
            cx, cy, cz = cx + points[i, 0], cy + points[i, 1], cz + points[i, 2]
            count += 1
    if count == 0:
        return 0
    cx, cy, cz = cx / count, cy / count, cz / count
    reach2 = 0.0
    for i in range(len(points)):
        if hits[i] >= 0:
            x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
            reach2 = max(reach2, x * x + y * y + z * z)
    reach = math.sqrt(reach2)
    number = 0
    for p in range(len(spheres)):
        if spheres[p, 3] == np.inf:
            continue
        x, y, z = spheres[p, 0] - cx, spheres[p, 1] - cy, spheres[p, 2] - cz
        along = x * light[0, 0] + y * light[0, 1] + z * light[0, 2]
        near = spheres[p, 3] + reach
        if along < -near:
            continue
        aside = near + light[6, 2] * max(0.0, along + near)
        if x * x + y * y + z * z - along * along <= aside * aside:
            found[number] = p
            number += 1
    return number


@compiled
def _lit_share(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    shadowers: IntArray,
    light: FloatArray,
    phase: float,
    x: float,
    y: float,
    z: float,
) -> float:
    """Share of the light's disc that is seen from a point."""
    rays = int(light[6, 0])
    if rays == 0 or len(shadowers) == 0:
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
        clear = 1
        for s in range(len(shadowers)):
            p = shadowers[s]
            if not may_hit(spheres, p, x, y, z, dx, dy, dz, np.inf):
                continue
            t = hit_shape(kinds, unit_T_world, half_sizes, p, x, y, z, dx, dy, dz, np.inf)
            if t < np.inf:
                clear = 0
                break
        lit += clear
    return lit / rays


@compiled
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


@compiled
def sky_colour(light: FloatArray, dz: float, length: float) -> tuple[float, float, float]:
    """Return linear RGB of the sky along a direction of the given length."""
    up = math.sqrt(min(1.0, max(0.0, dz / length)))
    return (
        light[4, 0] + up * (light[5, 0] - light[4, 0]),
        light[4, 1] + up * (light[5, 1] - light[4, 1]),
        light[4, 2] + up * (light[5, 2] - light[4, 2]),
    )


@compiled
def surface_colour(
    kinds: IntArray,
    unit_T_world: FloatArray,
    spheres: FloatArray,
    half_sizes: FloatArray,
    materials: FloatArray,
    shadowers: IntArray,
    light: FloatArray,
    phase: float,
    p: int,
    point: FloatArray,
    ray: FloatArray,
    distance: float,
    footprint: float,
) -> tuple[float, float, float]:
    """Return linear RGB of a point of shape p, seen along a unit ray from a distance (m)."""
    x, y, z = point[0], point[1], point[2]
    A = unit_T_world[p]
    ux = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + A[0, 3]
    uy = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + A[1, 3]
    uz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + A[2, 3]
    nx, ny, nz = surface_normal(kinds[p], A, half_sizes[p], ux, uy, uz)
    r, g, b = albedo(materials[p], kinds[p], half_sizes[p], ux, uy, uz, footprint)
    # A little off the surface, or it would shadow itself.
    x, y, z = x + 1e-4 * nx, y + 1e-4 * ny, z + 1e-4 * nz
    direct = max(0.0, nx * light[0, 0] + ny * light[0, 1] + nz * light[0, 2])
    if direct > 0.0:
        direct *= _lit_share(
            kinds, unit_T_world, spheres, half_sizes, shadowers, light, phase, x, y, z
        )
    around = light[3, 1] * (0.65 + 0.35 * nz)
    if light[6, 1] > 0.0:
        around *= _open_share(spheres, p, x, y, z, nx, ny, nz)
    glint = 0.0
    if direct > 0.0 and materials[p, 5] > 0.0:
        hx, hy, hz = light[0, 0] - ray[0], light[0, 1] - ray[1], light[0, 2] - ray[2]
        facing = (nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz)
        glint = materials[p, 5] * max(0.0, facing) ** 40 * direct
    level = light[3, 0] * direct + around
    near = math.exp(-((distance / light[3, 2]) ** 2))
    fade, sky = 1.0 - near, sky_colour(light, ray[2], 1.0)
    r, g, b = r * level + glint, g * level + glint, b * level + glint
    return near * r + fade * sky[0], near * g + fade * sky[1], near * b + fade * sky[2]
