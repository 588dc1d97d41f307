"""Smooth paths and headings through uncertain sightings, by banded least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.geometry.kernels import compiled
from tcrdata.types import BoolArray, FloatArray, IntArray

# Third, second and first differences of neighbouring values.
_JERK = np.array([-1.0, 3.0, -3.0, 1.0])
_ACCELERATION = np.array([1.0, -2.0, 1.0])
_TURN = np.array([-1.0, 1.0])


def smooth_path(
    index: IntArray,
    position: FloatArray,
    information: FloatArray,
    count: int,
    jerk_m: float,
    acceleration_m: float,
) -> FloatArray:
    """Return the (count, 2) path that minimises misfit and roughness.

    sum e' I e over the sightings + sum |third difference|^2 / jerk^2
    + sum |second difference|^2 / acceleration^2 over all steps.

    Args:
        index: (n,) steps with a sighting, rising, in [0, count).
        position: (n, 2) sighted positions, metres.
        information: (n, 2, 2) inverse covariances, 1 / m^2.
        count: number of steps.
        jerk_m: standard deviation of the third difference, metres.
        acceleration_m: standard deviation of the second difference, metres; wide, it only makes
            gaps and short paths well posed.
    """
    banded = np.zeros((7, 2 * count))
    right = np.zeros(2 * count)
    np.add.at(banded[0], 2 * index, information[:, 0, 0])
    np.add.at(banded[0], 2 * index + 1, information[:, 1, 1])
    np.add.at(banded[1], 2 * index, information[:, 0, 1])
    pull = np.einsum("nij,nj->ni", information, position)
    np.add.at(right, 2 * index, pull[:, 0])
    np.add.at(right, 2 * index + 1, pull[:, 1])
    for stencil, deviation in ((_JERK, jerk_m), (_ACCELERATION, acceleration_m)):
        _add_differences(banded, stencil, 2, np.full(count, 1 / deviation**2))
    # A floor for what nothing determines, such as the slope of a path of one sighting.
    banded[0] += 1e-9
    right += 1e-9 * np.tile(position.mean(axis=0), count)
    return _solved(banded, right).reshape(count, 2)


@compiled
def _add_differences(
    banded: FloatArray, stencil: FloatArray, stride: int, weights: FloatArray
) -> None:
    """Add sum weight (stencil . values)^2 to a lower banded matrix of interleaved values.

    The first so many weights count as there are places for the stencil.
    """
    steps = banded.shape[1] // stride - len(stencil) + 1
    for a in range(len(stencil)):
        for b in range(a + 1):
            for i in range(max(steps, 0) * stride):
                banded[stride * (a - b), stride * b + i] += (
                    stencil[a] * stencil[b] * weights[i // stride]
                )


def _solved(banded: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of a symmetric positive definite system, lower bands given.

    Raises:
        LinAlgError: the matrix is none, or holds what is no number.
    """
    from scipy.linalg import lapack

    if len(banded) == 2:
        _, _, solution, failed = lapack.dptsv(banded[0], banded[1, :-1], right)
    else:
        _, solution, failed = lapack.dpbsv(banded, right, lower=True)
    if failed or not np.isfinite(solution).all():
        raise np.linalg.LinAlgError("what is smoothed is not determined")
    return np.asarray(solution)


@dataclass(frozen=True)
class HeadingModel:
    """How headings vary.

    Attributes:
        turn_rad: standard deviation of the second difference.
        curvature_1pm: standard deviation of the first difference, a metre of the step ...
        still_rad: ... and without a step: what does not move does not turn.
    """

    turn_rad: float
    curvature_1pm: float
    still_rad: float


def course(path: FloatArray, position_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the (N,) continuous directions of the steps of an (N, 2) path, and their weights.

    A step's direction weighs (its length / position_m)^2, in 1 / rad^2.
    """
    step = gradient(path)
    chord = _chords(path)
    reference = _held(np.arctan2(-chord[:, 1], chord[:, 0]), np.hypot(*chord.T) > 4 * position_m)
    direction = np.arctan2(-step[:, 1], step[:, 0])
    weight = (step**2).sum(axis=1) / position_m**2
    return reference + wrapped(direction - reference, 2 * np.pi), weight


def smooth_heading(
    angles: FloatArray, weights: FloatArray, path: FloatArray, model: HeadingModel
) -> FloatArray:
    """Return (N,) smoothed angles: least squares of the misfit and of both differences.

    Args:
        angles: (N,) measured, continuous, radians.
        weights: (N,) 1 / rad^2; 0 where nothing was measured.
        path: (N, 2) the path, whose steps allow turning.
        model: how headings vary.
    """
    count = len(path)
    banded = np.zeros((3, count))
    banded[0] = weights + 1e-9
    _add_differences(banded, _ACCELERATION, 1, np.full(count, 1 / model.turn_rad**2))
    step = np.hypot(*np.diff(path, axis=0).T)
    spread = model.curvature_1pm * step + model.still_rad
    _add_differences(banded, _TURN, 1, 1 / spread**2)
    return _solved(banded[: min(count, 3)], (weights + 1e-9) * angles)


def gradient(values: FloatArray) -> FloatArray:
    """Return the central differences of (N, ...) values, one-sided at both ends; 0 for one."""
    result = np.zeros_like(values)
    if len(values) > 1:
        result[1:-1] = (values[2:] - values[:-2]) / 2.0
        result[0], result[-1] = values[1] - values[0], values[-1] - values[-2]
    return result


def _chords(path: FloatArray, reach: int = 5) -> FloatArray:
    """Return the (N, 2) chords from `reach` steps before to `reach` steps after each step."""
    steps = np.arange(len(path))
    after = np.minimum(steps + reach, len(path) - 1)
    before = np.maximum(steps - reach, 0)
    return np.asarray(path[after] - path[before])


def _held(angles: FloatArray, reliable: BoolArray) -> FloatArray:
    """Return unwrapped angles, the unreliable ones replaced by their nearest reliable one."""
    if not reliable.any():
        return np.full(len(angles), angles[len(angles) // 2])
    good = np.flatnonzero(reliable)
    unwrapped = np.unwrap(angles[good])
    nearest = np.abs(np.arange(len(angles))[:, None] - good[None]).argmin(axis=1)
    return np.asarray(unwrapped[nearest])


def wrapped(angles: FloatArray, period: float) -> FloatArray:
    """Return the angles in [-period / 2, period / 2)."""
    return np.asarray((angles + period / 2) % period - period / 2)
