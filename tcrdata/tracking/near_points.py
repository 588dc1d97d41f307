"""Loops over a frame's points, and over the rays to boxes: compiled, in one pass each.

They give the very bits of the array expressions that they stand for: numbers are taken in the same
order, points as float64. Sines and cosines are handed in, for compiled ones may round otherwise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, Float32Array, FloatArray


@compiled
def add_heat(
    values: FloatArray,
    points: FloatArray,
    boxes: FloatArray,
    turns: FloatArray,
    halves: FloatArray,
    reaches: FloatArray,
    heat: FloatArray,
) -> None:
    """Add the heat of boxes to the numbers of the (N, 3) points inside, one by one, up to 1.

    Args:
        values: (N,), changed in place.
        points: world.
        boxes: (M, 7).
        turns: (M, 2) cosine and sine of their yaws.
        halves: (M, 3) half sizes along the length, down, and across.
        reaches: (M,) in x and in z no point of a box is farther from its centre.
        heat: (M,).
    """
    for i in range(len(points)):
        for m in range(len(boxes)):
            dx, dz = points[i, 0] - boxes[m, 0], points[i, 2] - boxes[m, 2]
            if not (abs(dx) <= reaches[m] and abs(dz) <= reaches[m]):
                continue
            c, s, half = turns[m, 0], turns[m, 1], halves[m]
            if (
                abs(points[i, 1] - boxes[m, 1]) <= half[1]
                and abs(c * dx - s * dz) <= half[0]
                and abs(s * dx + c * dz) <= half[2]
            ):
                values[i] = min(values[i] + heat[m], 1.0)


@compiled
def first_returns(
    cells: NDArray[np.int32], nearest_m: Float32Array, window_m: Float32Array
) -> FloatArray:
    """Return the range of the first return in each of (N,) cells of bordered range images.

    A LiDAR leaves cells empty between its beams: the window around says what is there. NaN where
    the cell is 0: no cell.
    """
    nearest, window = nearest_m.ravel(), window_m.ravel()
    result = np.full(len(cells), np.nan)
    for i in range(len(cells)):
        if cells[i] > 0:
            first = nearest[cells[i]]
            result[i] = window[cells[i]] if np.isinf(first) else first
    return result


@compiled
def spread(shares: FloatArray, box: FloatArray, turn: tuple[float, float]) -> FloatArray:
    """Return (N, 3) world points that lie at shares of a (7,) box's length, height and width.

    Args:
        shares: (N, 3) from its centre.
        box: world.
        turn: cosine and sine of its yaw.
    """
    c, s = turn
    result = np.empty((len(shares), 3))
    for i in range(len(shares)):
        along, across = shares[i, 0] * box[3], shares[i, 2] * box[4]
        result[i, 0] = box[0] + c * along + s * across
        result[i, 1] = box[1] + shares[i, 1] * box[5]
        result[i, 2] = box[2] - s * along + c * across
    return result


@compiled
def hidden_rays(
    origin: FloatArray,
    points: FloatArray,
    box: FloatArray,
    turn: tuple[float, float],
    ranges: FloatArray,
    nearest: FloatArray,
    margin_m: float,
) -> int:
    """Return how many rays to (N, 3) points of a (7,) box something stops before they enter it.

    Args:
        origin: (3,) where the rays begin.
        points: in the box, world.
        box: world.
        turn: cosine and sine of its yaw.
        ranges: (N,) of the points.
        nearest: (N,) of the first returns; NaN outside the view: counted as stopped.
        margin_m: a return must be this much nearer than the box.
    """
    c, s = turn
    half = (max(box[3] / 2, 1e-6), max(box[5] / 2, 1e-6), max(box[4] / 2, 1e-6))
    dx, dz = origin[0] - box[0], origin[2] - box[2]
    start = (c * dx - s * dz, origin[1] - box[1], s * dx + c * dz)
    count = 0
    for i in range(len(points)):
        dx, dz = points[i, 0] - box[0], points[i, 2] - box[2]
        there = (c * dx - s * dz, points[i, 1] - box[1], s * dx + c * dz)
        entry = 0.0
        for axis in range(3):
            way = there[axis] - start[axis]
            way = 1e-9 if abs(way) < 1e-9 else way
            one, other = (-half[axis] - start[axis]) / way, (half[axis] - start[axis]) / way
            entry = max(entry, min(one, other))
        if np.isnan(nearest[i]) or nearest[i] < entry * ranges[i] - margin_m:
            count += 1
    return count


@compiled
def blurred(values: Float32Array, weights: FloatArray) -> Float32Array:
    """Return (U, V, W, C) float32 numbers blurred along the first three axes; outside there is 0.

    The very bits of `scipy.ndimage.correlate1d` along one axis after the other, mode `constant`:
    sums in float64, of pairs from the outermost in; importing that takes longer than a clip's blur.

    Args:
        values: what is blurred.
        weights: (2 R + 1,), symmetric.
    """
    reach = len(weights) // 2
    source = values
    for axis in range(3):
        count = source.shape[axis]
        inner, outer = source.shape[3], 1
        for after in range(axis + 1, 3):
            inner *= source.shape[after]
        for before in range(axis):
            outer *= source.shape[before]
        lines = source.reshape(outer, count, inner)
        result = np.empty((outer, count, inner), np.float32)
        sums = np.empty(inner)
        for o in range(outer):
            for n in range(count):
                for k in range(inner):
                    sums[k] = lines[o, n, k] * weights[reach]
                for step in range(reach, 0, -1):
                    low, high = n - step, n + step
                    if low < 0 and high >= count:
                        continue
                    for k in range(inner):
                        a = np.float64(lines[o, low, k]) if low >= 0 else 0.0
                        b = np.float64(lines[o, high, k]) if high < count else 0.0
                        sums[k] += (a + b) * weights[reach - step]
                for k in range(inner):
                    result[o, n, k] = sums[k]
        source = result.reshape(source.shape)
    return source


@compiled
def unit_rows(features: FloatArray | Float32Array) -> Float32Array:
    """Return rows of (N, C), C > 0, scaled to length 1 in their own type, as float32."""
    result = np.empty(features.shape, np.float32)
    for i in range(len(features)):
        total = features[i, 0] * features[i, 0]
        for c in range(1, features.shape[1]):
            total += features[i, c] * features[i, c]
        length = max(np.sqrt(total), features.dtype.type(1e-9))
        for c in range(features.shape[1]):
            result[i, c] = features[i, c] / length
    return result


@compiled
def unit_directions(cosines: Float32Array, sines: Float32Array, first: float) -> Float32Array:
    """Return (N, 3) rows (first, cosine, sine) scaled to length 1 in float64, as float32."""
    result = np.empty((len(cosines), 3), np.float32)
    for i in range(len(cosines)):
        c, s = np.float64(cosines[i]), np.float64(sines[i])
        length = np.sqrt(first * first + c * c + s * s)
        result[i, 0], result[i, 1], result[i, 2] = first / length, c / length, s / length
    return result


@compiled
def world_points(points: Float32Array, kept: BoolArray, matrix: Float32Array) -> Float32Array:
    """Return the kept ones of (N, 3) points, moved by the first rows of a (4, 4) matrix."""
    count = 0
    for i in range(len(kept)):
        count += kept[i]
    result = np.empty((count, 3), np.float32)
    n = 0
    for i in range(len(points)):
        if not kept[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for axis in range(3):
            a, b, c = matrix[axis, 0], matrix[axis, 1], matrix[axis, 2]
            result[n, axis] = a * x + b * y + c * z + matrix[axis, 3]
        n += 1
    return result
