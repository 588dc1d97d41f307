"""Compiled rows of three: rays, points and pixels, written in place.

Number by number: where one array is assigned to another, numba compiles the text of an error that
cannot come, for seconds.
"""

from __future__ import annotations

import math

from tcrdata.geometry.kernels import compiled
from tcrdata.types import FloatArray


@compiled
def norm(row: FloatArray) -> float:
    """Return the length of a vector of three."""
    return math.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2])


@compiled
def add(pixel: FloatArray, colour: tuple[float, float, float], weight: float) -> None:
    """Add a weighted colour to a pixel."""
    pixel[0] += weight * colour[0]
    pixel[1] += weight * colour[1]
    pixel[2] += weight * colour[2]


@compiled
def reach(point: FloatArray, origin: FloatArray, time: float, ray: FloatArray) -> None:
    """Set a point to where a ray is at a time."""
    for axis in range(3):
        point[axis] = origin[axis] + time * ray[axis]


@compiled
def average(rows: FloatArray, first: int, count: int) -> None:
    """Set the first of some rows to their mean."""
    for axis in range(3):
        total = 0.0
        for i in range(first, first + count):
            total += rows[i, axis]
        rows[first, axis] = total / count


@compiled
def aim(R: FloatArray, first: int, row: int, n: int, rays: FloatArray) -> None:
    """Fill in the rays of a strip of pixels, n * n samples each, pixel by pixel."""
    for i in range(len(rays)):
        sample = i % (n * n)
        u = first + i // (n * n) + (sample % n + 0.5) / n - 0.5
        v = row + (sample // n + 0.5) / n - 0.5
        for axis in range(3):
            rays[i, axis] = R[axis, 0] * u + R[axis, 1] * v + R[axis, 2]
