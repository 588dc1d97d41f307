"""Compiled tests of one ray against one analytic shape; `raycasting` says in which frames."""

from __future__ import annotations

import math

import numpy as np

from tcrdata.geometry.kernels import compiled
from tcrdata.types import FloatArray, IntArray

PLANE, SPHERE, BOX, CYLINDER, CONE = range(5)
RELIEF_STEPS = 12


@compiled
def may_hit(
    spheres: FloatArray,
    p: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
) -> bool:
    """Tell whether a ray can meet the ball around shape p before t = limit."""
    radius = spheres[p, 3]
    if radius == np.inf:
        return True
    cx, cy, cz = spheres[p, 0] - ox, spheres[p, 1] - oy, spheres[p, 2] - oz
    outside = cx * cx + cy * cy + cz * cz - radius * radius
    if outside <= 0.0:
        return True
    along = cx * dx + cy * dy + cz * dz
    if along <= 0.0:
        return False
    length2 = dx * dx + dy * dy + dz * dz
    if along * along < outside * length2:
        return False
    if limit == np.inf:
        return True
    past = along - limit * length2
    return bool(past <= 0.0 or past * past <= radius * radius * length2)


@compiled
def hit_shape(
    kinds: IntArray,
    unit_T_world: FloatArray,
    half_sizes: FloatArray,
    p: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
) -> float:
    """Return the t > 0 at which a ray enters shape p, or inf; inf too where t is surely > limit."""
    A = unit_T_world[p]
    px = A[0, 0] * ox + A[0, 1] * oy + A[0, 2] * oz + A[0, 3]
    py = A[1, 0] * ox + A[1, 1] * oy + A[1, 2] * oz + A[1, 3]
    pz = A[2, 0] * ox + A[2, 1] * oy + A[2, 2] * oz + A[2, 3]
    qx = A[0, 0] * dx + A[0, 1] * dy + A[0, 2] * dz
    qy = A[1, 0] * dx + A[1, 1] * dy + A[1, 2] * dz
    qz = A[2, 0] * dx + A[2, 1] * dy + A[2, 2] * dz
    kind = kinds[p]
    if kind == BOX:
        return _hit_box(px, py, pz, qx, qy, qz)
    if kind == CYLINDER:
        return _hit_cylinder(px, py, pz, qx, qy, qz)
    if kind == SPHERE:
        return _hit_sphere(px, py, pz, qx, qy, qz)
    if kind == CONE:
        return _hit_cone(px, py, pz, qx, qy, qz)
    return _hit_plane(px, py, pz, qx, qy, qz, half_sizes[p, 0], half_sizes[p, 2], limit)


@compiled
def _hit_sphere(px: float, py: float, pz: float, qx: float, qy: float, qz: float) -> float:
    a = qx * qx + qy * qy + qz * qz
    b = px * qx + py * qy + pz * qz
    c = px * px + py * py + pz * pz - 1.0
    root = b * b - a * c
    if root < 0.0:
        return np.inf
    t = (-b - math.sqrt(root)) / a
    return t if t > 0.0 else np.inf


@compiled
def _slab(p: float, q: float) -> tuple[float, float]:
    if q == 0.0:
        return (-np.inf, np.inf) if -1.0 <= p <= 1.0 else (np.inf, -np.inf)
    a, b = (-1.0 - p) / q, (1.0 - p) / q
    return (a, b) if a < b else (b, a)


@compiled
def _hit_box(px: float, py: float, pz: float, qx: float, qy: float, qz: float) -> float:
    x0, x1 = _slab(px, qx)
    y0, y1 = _slab(py, qy)
    z0, z1 = _slab(pz, qz)
    enter, leave = max(x0, y0, z0), min(x1, y1, z1)
    return enter if 0.0 < enter <= leave else np.inf


@compiled
def _hit_cylinder(px: float, py: float, pz: float, qx: float, qy: float, qz: float) -> float:
    enter, leave = _slab(pz, qz)
    a = qx * qx + qy * qy
    b = px * qx + py * qy
    c = px * px + py * py - 1.0
    if a == 0.0:
        if c > 0.0:
            return np.inf
    else:
        root = b * b - a * c
        if root < 0.0:
            return np.inf
        root = math.sqrt(root)
        enter, leave = max(enter, (-b - root) / a), min(leave, (-b + root) / a)
    return enter if 0.0 < enter <= leave else np.inf


@compiled
def _hit_cone(px: float, py: float, pz: float, qx: float, qy: float, qz: float) -> float:
    best = np.inf
    # The radius at height z is (1 - z) / 2 = w - t * s along the ray.
    w, s = 0.5 * (1.0 - pz), 0.5 * qz
    a = qx * qx + qy * qy - s * s
    b = px * qx + py * qy + w * s
    c = px * px + py * py - w * w
    root = b * b - a * c
    if root >= 0.0 and a != 0.0:
        root = math.sqrt(root)
        for t in ((-b - root) / a, (-b + root) / a):
            if 0.0 < t < best and abs(pz + t * qz) <= 1.0:
                best = t
    if qz > 0.0:
        t = (-1.0 - pz) / qz
        if 0.0 < t < best and (px + t * qx) ** 2 + (py + t * qy) ** 2 <= 1.0:
            best = t
    return best


@compiled
def relief(x: float, y: float, wavelength_m: float, amplitude_m: float) -> float:
    """Return the height of an uneven plane, within +-amplitude: two crossing sines."""
    if amplitude_m == 0.0:
        return 0.0
    k = 2.0 * math.pi / wavelength_m
    return 0.5 * amplitude_m * (math.sin(k * x) + math.sin(1.3 * k * y + 1.0))


@compiled
def _hit_plane(
    px: float,
    py: float,
    pz: float,
    qx: float,
    qy: float,
    qz: float,
    wavelength_m: float,
    amplitude_m: float,
    limit: float,
) -> float:
    if qz >= 0.0:
        return np.inf
    if (amplitude_m - pz) / qz > limit:
        return np.inf
    t = -pz / qz
    if amplitude_m > 0.0:
        # The relief is much flatter than the ray, so this fixed point is reached quickly.
        for _ in range(RELIEF_STEPS):
            t = (relief(px + t * qx, py + t * qy, wavelength_m, amplitude_m) - pz) / qz
    return t if t > 0.0 else np.inf


@compiled
def gather_candidates(
    spheres: FloatArray, origin: FloatArray, directions: FloatArray, limit: float, found: IntArray
) -> int:
    """Find the shapes whose ball a bundle of rays may meet before t = limit.

    Args:
        spheres: (P, 4) balls, see `raycasting.Primitives`.
        origin: (3,) of all rays.
        directions: (K, 3); rays within the cone around them are covered.
        limit: lengths of the longest direction.
        found: (P,) filled with indices, in order.

    Returns:
        How many were found.
    """
    ax, ay, az, longest = 0.0, 0.0, 0.0, 0.0
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        length = math.sqrt(x * x + y * y + z * z)
        longest = max(longest, length)
        ax, ay, az = ax + x / length, ay + y / length, az + z / length
    scale = 1.0 / math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * scale, ay * scale, az * scale
    cos_cone = 1.0
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        cos_cone = min(cos_cone, (ax * x + ay * y + az * z) / math.sqrt(x * x + y * y + z * z))
    sin_cone = math.sqrt(max(0.0, 1.0 - cos_cone * cos_cone))
    count = 0
    for p in range(len(spheres)):
        radius = spheres[p, 3]
        x, y, z = spheres[p, 0] - origin[0], spheres[p, 1] - origin[1], spheres[p, 2] - origin[2]
        distance = math.sqrt(x * x + y * y + z * z)
        if distance > radius:
            if distance - radius > limit * longest:
                continue
            sin_ball = radius / distance
            cos_ball = math.sqrt(1.0 - sin_ball * sin_ball)
            # cos(cone + ball): the widest angle off the axis at which the ball is touched.
            bound = cos_cone * cos_ball - sin_cone * sin_ball
            if ax * x + ay * y + az * z < (bound - 1e-9) * distance:
                continue
        found[count] = p
        count += 1
    return count
