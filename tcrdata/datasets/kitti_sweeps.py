"""Velodyne sweeps: float32 x, y, z, reflectance of each point, 16 bytes a point."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.geometry.kernels import kernel
from tcrdata.types import Float32Array, FloatArray

_COLUMNS = ("x", "y", "z", "reflectance")
_POINT_BYTES = 4 * len(_COLUMNS)
# No sweep reaches so far: such numbers are bytes that are no sweep.
_LARGEST_M = 10_000.0


def size_error(name: str, size_bytes: int) -> str | None:
    """Return what is wrong with a sweep of that size, in one line; None when nothing is."""
    if size_bytes == 0:
        return f"sweep {name} has no points; fetch it again"
    if size_bytes % _POINT_BYTES:
        return (
            f"sweep {name} is cut short: {size_bytes} bytes are no multiple of {_POINT_BYTES}; "
            "fetch it again"
        )
    return None


def read_sweep(path: Path, frame: int) -> Float32Array:
    """Return (N, 4) float32: x, y, z in the Velodyne's frame (m) and reflectance in [0, 1].

    Raises:
        FrameError: the sweep is missing, cut short, empty, or a number in it is not finite.
    """
    try:
        values = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise FrameError(f"frame {frame}: cannot read '{path}': {error.strerror}") from error
    wrong = size_error(path.name, len(values))
    if wrong:
        raise FrameError(f"frame {frame}: {wrong}")
    points = values.view("<f4").astype(np.float32, copy=False).reshape(-1, len(_COLUMNS))
    # One pass over all; NaN, too, comes out as no number below the largest.
    if points.min() > -_LARGEST_M and points.max() < _LARGEST_M:
        return points
    for column, name in enumerate(_COLUMNS):
        bad = np.count_nonzero(~(np.abs(points[:, column]) < _LARGEST_M))
        if bad:
            raise FrameError(
                f"frame {frame}: sweep {path.name}: {bad} of {len(points)} points have no finite "
                f"{name} below {_LARGEST_M:g}; fetch it again"
            )
    return points


def to_level(points: Float32Array, level_T_sensor: FloatArray) -> Float32Array:
    """Return (N, 3) positions in the level frame (m) of the (N, 4) points of a sweep.

    Args:
        points: x, y, z, reflectance in the Velodyne's frame.
        level_T_sensor: (4, 4), Velodyne to level frame.
    """
    result = np.empty((len(points), 3), dtype=np.float32)
    _transform(points, level_T_sensor[:3].astype(np.float32), result)
    return result


# One term after the other: a matrix product would round as the threads share it out.
@kernel(nogil=True, error_model="numpy")
def _transform(points: Float32Array, matrix: Float32Array, result: Float32Array) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for row in range(3):
            turned = (matrix[row, 0] * x + matrix[row, 1] * y) + matrix[row, 2] * z
            result[i, row] = turned + matrix[row, 3]
