"""Velodyne sweeps: float32 x, y, z, reflectance of each point, 16 bytes a point."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.geometry.kernels import compiled
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
        FrameError: the sweep is missing, cut short or empty.
    """
    try:
        values = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise FrameError(f"frame {frame}: cannot read '{path}': {error.strerror}") from error
    wrong = size_error(path.name, len(values))
    if wrong:
        raise FrameError(f"frame {frame}: {wrong}")
    return values.view("<f4").astype(np.float32, copy=False).reshape(-1, len(_COLUMNS))


def to_level(
    points: Float32Array, level_T_sensor: FloatArray, frame: int, name: str
) -> tuple[Float32Array, Float32Array]:
    """Return (N, 3) positions in the level frame (m) and (N,) reflectances of a sweep's points.

    Args:
        points: (N, 4) x, y, z, reflectance in the Velodyne's frame.
        level_T_sensor: (4, 4), Velodyne to level frame.
        frame: number of the frame, for errors.
        name: of the sweep, for errors.

    Raises:
        FrameError: a number is not finite.
    """
    xyz = np.empty((len(points), 3), np.float32)
    reflectance = np.empty(len(points), np.float32)
    limit = np.float32(_LARGEST_M)
    if not _split(points, level_T_sensor[:3].astype(np.float32), limit, xyz, reflectance):
        raise FrameError(f"frame {frame}: sweep {name}: {_wrong_numbers(points)}; fetch it again")
    return xyz, reflectance


def _wrong_numbers(points: Float32Array) -> str:
    """What is wrong with points of which a number is not finite: of the first such column."""
    wrong = (~(np.abs(points) < _LARGEST_M)).sum(axis=0)
    column = int(np.argmax(wrong > 0))
    return (
        f"{wrong[column]} of {len(points)} points have no finite {_COLUMNS[column]} "
        f"below {_LARGEST_M:g}"
    )


# One pass over all: sweeps are read again and again. One term after the other: a matrix product
# would round as the threads share it out.
@compiled
def _split(
    points: Float32Array,
    matrix: Float32Array,
    limit: np.float32,
    xyz: Float32Array,
    reflectance: Float32Array,
) -> bool:
    """Fill in the level positions and reflectances; return whether all numbers are finite."""
    bad = 0
    for i in range(len(points)):
        x, y, z, shine = points[i, 0], points[i, 1], points[i, 2], points[i, 3]
        # NaN, too, is not below the limit.
        fine = (abs(x) < limit) & (abs(y) < limit) & (abs(z) < limit) & (abs(shine) < limit)
        bad += not fine
        for row in range(3):
            turned = (matrix[row, 0] * x + matrix[row, 1] * y) + matrix[row, 2] * z
            xyz[i, row] = turned + matrix[row, 3]
        reflectance[i] = shine
    return bad == 0
