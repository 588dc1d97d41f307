"""Smoothing: known paths through noise, gaps and stops."""

from __future__ import annotations

import numpy as np
import pytest

from tcrdata.evidence.path_smoothing import HeadingModel, course, smooth_heading, smooth_path

MODEL = HeadingModel(turn_rad=0.005, curvature_1pm=0.2, still_rad=0.005)


def smoothed(index, position, count, deviation=0.1):
    information = np.broadcast_to(np.eye(2) / deviation**2, (len(index), 2, 2))
    return smooth_path(np.asarray(index), position, information, count, 0.003, 0.1)


def test_a_straight_path_is_kept_and_its_gaps_are_filled():
    steps = np.array([0, 1, 2, 3, 7, 8, 9, 10])
    truth = np.arange(11)[:, None] * [1.0, 0.3]
    path = smoothed(steps, truth[steps], 11)
    assert path == pytest.approx(truth, abs=1e-3)


def test_noise_shrinks():
    rng = np.random.default_rng(0)
    t = np.arange(40)
    truth = np.stack([0.8 * t, 5 * np.sin(t / 25)], axis=1)
    noisy = truth + rng.normal(0, 0.1, truth.shape)
    error = np.linalg.norm(smoothed(t, noisy, 40) - truth, axis=1).mean()
    assert error < 0.6 * np.linalg.norm(noisy - truth, axis=1).mean()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_paths_are_well_posed(count):
    position = np.arange(count)[:, None] * [1.0, 0.0] + 5
    path = smoothed(np.arange(count), position, count)
    angles, weights = course(path, 0.05)
    assert np.isfinite(smooth_heading(angles, weights, path, MODEL)).all()
    assert path == pytest.approx(position, abs=1e-3)


def test_a_heading_has_kittis_sense_and_survives_a_stop():
    moving = np.stack([np.zeros(15), np.arange(15.0)], axis=1)
    standing = np.repeat(moving[-1:], 10, axis=0) + np.random.default_rng(1).normal(
        0, 0.005, (10, 2)
    )
    path = np.concatenate([moving, standing])
    yaw = smooth_heading(*course(path, 0.05), path, MODEL)
    assert yaw == pytest.approx(-np.pi / 2, abs=0.1)
