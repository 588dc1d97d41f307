"""What is painted on shapes: solid noise and a few patterns, as compiled functions of a point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tcrdata.geometry.intersections import BOX, PLANE
from tcrdata.geometry.kernels import compiled
from tcrdata.types import FloatArray

Pattern = Literal["noise", "planks", "windows", "road"]
NOISE, PLANKS, WINDOWS, ROAD = range(4)
PATTERNS: dict[str, int] = {"noise": NOISE, "planks": PLANKS, "windows": WINDOWS, "road": ROAD}


@dataclass(frozen=True)
class Material:
    """How a shape looks.

    Attributes:
        colour: linear RGB in [0, 1].
        amplitude: share by which the solid noise darkens and brightens.
        frequency_per_m: of the noise's coarsest octave.
        gloss: strength of the highlight.
        pattern: what is painted on it.
        extra: two numbers for the pattern; a road's are (curvature per m, half width m).
    """

    colour: tuple[float, float, float]
    amplitude: float = 0.35
    frequency_per_m: float = 3.0
    gloss: float = 0.0
    pattern: Pattern = "noise"
    extra: tuple[float, float] = (0.0, 0.0)


def material_rows(materials: Sequence[Material], seeds: Sequence[int]) -> FloatArray:
    """Return (P, 10) numbers of P materials; a seed shifts a material's noise."""
    return np.array(
        [
            (*m.colour, m.amplitude, m.frequency_per_m, m.gloss, PATTERNS[m.pattern], s, *m.extra)
            for m, s in zip(materials, seeds, strict=True)
        ],
        dtype=np.float64,
    ).reshape(-1, 10)


@compiled
def _lattice(i: int, j: int, k: int, seed: int) -> float:
    h = np.uint32(i) * np.uint32(0x8DA6B343) ^ np.uint32(j) * np.uint32(0xD8163841)
    h = np.uint32(
        h ^ np.uint32(k) * np.uint32(0xCB1AB31F) ^ np.uint32(seed) * np.uint32(0x9E3779B1)
    )
    h = np.uint32((h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    h = np.uint32((h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39))
    return np.float64(h ^ (h >> np.uint32(15))) / 2147483648.0 - 1.0


@compiled
def _value_noise(x: float, y: float, z: float, seed: int) -> float:
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
    i, j, k = int(i), int(j), int(k)
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                weight = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                total += weight * _lattice(i + a, j + b, k + c, seed)
    return total


@compiled
def _solid_noise(
    x: float, y: float, z: float, frequency: float, footprint: float, seed: int
) -> float:
    # Octaves finer than a pixel are left out, or they would flicker.
    total, weight = 0.0, 0.6
    for octave in range(4):
        visible = min(1.0, max(0.0, 0.5 / (frequency * footprint + 1e-9) - 0.5))
        if visible > 0.0:
            shift = 17.3 * octave
            total += (
                visible
                * weight
                * _value_noise(
                    x * frequency + shift, y * frequency - shift, z * frequency, seed + octave
                )
            )
        frequency *= 2.1
        weight *= 0.72
    return total


@compiled
def road_coordinates(x: float, y: float, curvature: float) -> tuple[float, float]:
    """Return metres along and to the left of an arc that leaves the origin along x."""
    if abs(curvature) < 1e-9:
        return x, y
    radius = 1.0 / curvature
    sign = math.copysign(1.0, radius)
    along = abs(radius) * math.atan2(x, sign * (radius - y))
    return along, radius - sign * math.hypot(x, y - radius)


@compiled
def _road_tone(x: float, y: float, curvature: float, half_width: float) -> float:
    along, across = road_coordinates(x, y, curvature)
    side = abs(across)
    if abs(side - half_width + 0.35) < 0.07 or (side < 0.07 and along % 6.0 < 3.0):
        return 3.4
    return 1.0


@compiled
def _window_tone(kind: int, x: float, y: float, z: float, mx: float, my: float, mz: float) -> float:
    if kind != BOX or abs(z) > 0.999:
        return 1.0
    run = my if abs(x) > abs(y) else mx
    u, v = run / 2.6 - math.floor(run / 2.6), mz / 3.0 - math.floor(mz / 3.0)
    return 0.35 if 0.3 < u < 0.7 and 0.3 < v < 0.75 else 1.0


@compiled
def _plank_tone(x: float, y: float, footprint: float, seed: int) -> float:
    row = math.floor(y / 1.1)
    shift = 2.7 * _lattice(int(row), 3, 5, seed)
    board = math.floor((x + shift) / 5.0)
    edge = min(y / 1.1 - row, row + 1 - y / 1.1) * 1.1
    end = min((x + shift) / 5.0 - board, board + 1 - (x + shift) / 5.0) * 5.0
    # As wide as a pixel at least, and fainter for it.
    width = max(0.02, 1.5 * footprint)
    groove = 1.0 - 0.25 * (0.02 / width) * math.exp(-((min(edge, end) / width) ** 2))
    return groove * (1.0 + 0.07 * _lattice(int(row), int(board), 9, seed))


@compiled
def albedo(
    material: FloatArray,
    kind: int,
    half_size: FloatArray,
    x: float,
    y: float,
    z: float,
    footprint: float,
) -> tuple[float, float, float]:
    """Return linear RGB at a point of the unit shape; details finer than the footprint (m) fade."""
    pattern, seed = int(material[6]), int(material[7])
    mx, my, mz = x, y, 0.0
    if kind != PLANE:
        mx, my, mz = x * half_size[0], y * half_size[1], z * half_size[2]
    if pattern == PLANKS:
        grain = _solid_noise(0.18 * mx, mx * 0.1 + my * 1.6, mz, material[4], footprint, seed)
        noise = 0.5 * grain + 0.5 * _solid_noise(mx, my, mz, material[4], footprint, seed + 50)
        tone = _plank_tone(mx, my, footprint, seed)
    else:
        noise = _solid_noise(mx, my, mz, material[4], footprint, seed)
        tone = 1.0
    if pattern == WINDOWS:
        tone = _window_tone(kind, x, y, z, mx, my, mz)
    elif pattern == ROAD:
        tone = _road_tone(mx, my, material[8], material[9])
    tone *= max(0.05, 1.0 + material[3] * noise)
    return material[0] * tone, material[1] * tone, material[2] * tone
