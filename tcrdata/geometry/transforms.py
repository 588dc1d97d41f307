"""Rigid transforms as (4, 4) arrays: `a_T_b` takes points from b to a."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tcrdata.types import FloatArray


def transform_points(a_T_b: ArrayLike, points_b: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return (N, 3) points in frame a, in the dtype of the points; takes (3, 4) or (4, 4).

    Sums in a fixed order, without a matrix product: its bits could depend on the threads.
    """
    matrix = np.asarray(a_T_b, dtype=np.float64).astype(points_b.dtype)
    x, y, z = points_b[:, 0], points_b[:, 1], points_b[:, 2]
    result: NDArray[np.floating] = np.empty((len(points_b), 3), dtype=points_b.dtype)
    for axis in range(3):
        a, b, c, shift = matrix[axis]
        result[:, axis] = a * x + b * y + c * z + shift
    return result


def inverse(a_T_b: ArrayLike) -> FloatArray:
    """Return `b_T_a` of a rigid transform."""
    matrix = np.asarray(a_T_b, dtype=np.float64)
    result = np.eye(4)
    result[:3, :3] = matrix[:3, :3].T
    result[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result


def yaw_rotation(angle_rad: float) -> FloatArray:
    """Return the (3, 3) rotation about y that adds an angle to every yaw."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


def level_transformed(matrix: FloatArray, points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return (N, 3) points times a (3, 3) matrix that leaves what is level so, in their own type.

    Written out: a product with so small a matrix takes ten times as long.
    """
    m = matrix.astype(points.dtype)
    moved = np.empty_like(points)
    moved[:, 0] = m[0, 0] * points[:, 0] + m[0, 2] * points[:, 2]
    moved[:, 1] = m[1, 1] * points[:, 1]
    moved[:, 2] = m[2, 0] * points[:, 0] + m[2, 2] * points[:, 2]
    return moved


def rotation_angle(rotation: ArrayLike) -> float:
    """Return the angle in radians of a (3, 3) rotation (or of a (4, 4) transform's)."""
    matrix = np.asarray(rotation, dtype=np.float64)[:3, :3]
    sine = 0.5 * np.linalg.norm(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    return float(np.arctan2(sine, 0.5 * (np.trace(matrix) - 1.0)))


def as_tuples(matrix: ArrayLike) -> tuple[tuple[float, ...], ...]:
    """Return a 2D array as nested tuples, so that frozen dataclasses can hold it."""
    return tuple(tuple(float(v) for v in row) for row in np.asarray(matrix, dtype=np.float64))


def level_project(
    level_projection: FloatArray, points: NDArray[np.floating]
) -> tuple[FloatArray, FloatArray]:
    """Project (N, 3) level points.

    Returns:
        (N, 2) pixels (column, row) and (N,) depths in metres; pixels of points at a depth
        <= 0 are NaN.
    """
    homogeneous = np.asarray(transform_points(level_projection, points.astype(np.float64)))
    depth = homogeneous[:, 2]
    safe = np.where(depth > 0, depth, np.nan)
    return homogeneous[:, :2] / safe[:, None], depth
