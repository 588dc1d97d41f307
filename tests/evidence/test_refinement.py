"""Refinement: a box seen on the sides that face the sensor, moving, comes back whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcrdata.evidence.refinement import quantile, refine
from tcrdata.evidence.sightings import RefinementSettings, Sightings
from tcrdata.geometry.boxes import bev_iou

SIZE = (4.2, 1.8)


def seen_sides(center, yaw, size, rng, cut=None):
    """Points on the sides of a box that face a sensor at the origin, (N, 2)."""
    axes = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    half = np.array(size) / 2
    sensor = axes @ -np.asarray(center)
    points = []
    for axis in range(2):
        if abs(sensor[axis]) > half[axis]:
            other = np.linspace(-half[1 - axis], half[1 - axis], 40)
            side = np.empty((40, 2))
            side[:, axis] = math.copysign(half[axis], sensor[axis])
            side[:, 1 - axis] = other
            points.append(side)
    local = np.concatenate(points)
    if cut is not None:
        local = local[local[:, 0] < cut]
    return np.asarray(center) + local @ axes + rng.normal(0, 0.02, local.shape)


def sightings_of(centers, yaws, size=SIZE, keep=None, cuts=None, hidden=None):
    rng = np.random.default_rng(0)
    steps = np.arange(len(centers)) if keep is None else np.asarray(keep)
    parts = [
        seen_sides(centers[i], yaws[i], size, rng, None if cuts is None else cuts[i]) for i in steps
    ]
    n = len(steps)
    return Sightings(
        step=steps - steps[0],
        xz=np.concatenate(parts),
        offsets=np.cumsum([0, *(len(p) for p in parts)]),
        sensor=np.zeros((n, 2)),
        distrusted=np.zeros((n, 4), dtype=bool) if hidden is None else hidden[steps],
        counts_for_size=np.ones(n, dtype=bool),
        above_top_m=np.full(n, 0.2),
    )


def straight(count, start=(-12.0, 14.0), step=(0.8, -0.1)):
    centers = np.asarray(start) + np.arange(count)[:, None] * np.asarray(step)
    return centers, np.full(count, math.atan2(-step[1], step[0]))


def overlaps(path, centers, yaws, size=SIZE):
    def boxes(c, y, s):
        return np.array([[p[0], 0, p[1], *s, 1.5, a] for p, a in zip(c, y, strict=True)])

    ours = boxes(path.center, path.yaw_rad, (path.length, path.width))
    return np.array(
        [
            bev_iou(o[None], t[None])[0, 0]
            for o, t in zip(ours, boxes(centers, yaws, size), strict=True)
        ]
    )


def test_a_straight_drive_past_the_sensor_gives_whole_boxes():
    centers, yaws = straight(30)
    path = refine(sightings_of(centers, yaws), RefinementSettings(), 0.1)
    assert path.length == pytest.approx(4.25, abs=0.15)
    assert path.width == pytest.approx(1.85, abs=0.15)
    assert np.abs(np.sin(path.yaw_rad - yaws)).max() < 0.05
    assert overlaps(path, centers, yaws).min() > 0.85


def test_a_curve_keeps_the_heading():
    yaws = -np.linspace(0.0, 1.4, 30)
    # The rear axle runs along the heading; the centre is 0.3 lengths ahead of it.
    heading = np.stack([np.cos(yaws), -np.sin(yaws)], axis=1)
    centers = np.array([-10.0, 9.0]) + np.cumsum(0.7 * heading, axis=0) + 0.3 * SIZE[0] * heading
    path = refine(sightings_of(centers, yaws), RefinementSettings(), 0.1)
    assert np.abs(path.yaw_rad - yaws).max() < 0.12
    assert overlaps(path, centers, yaws).min() > 0.75


def test_missed_frames_are_filled():
    centers, yaws = straight(25)
    keep = [i for i in range(25) if i not in (9, 10, 11)]
    path = refine(sightings_of(centers, yaws, keep=keep), RefinementSettings(), 0.1)
    assert len(path.center) == 25
    assert overlaps(path, centers, yaws)[9:12].min() > 0.85


def test_an_edge_that_is_hidden_is_not_an_anchor():
    centers, yaws = straight(30, start=(-30.0, 8.0), step=(0.5, 0.0))
    # In ten frames something hides the front half, so that the last point is no edge.
    cuts = [0.0 if 10 <= i < 20 else None for i in range(30)]
    hidden = np.zeros((30, 4), dtype=bool)
    hidden[10:20, 1] = True
    trusting = refine(sightings_of(centers, yaws, cuts=cuts), RefinementSettings(), 0.1)
    knowing = refine(
        sightings_of(centers, yaws, cuts=cuts, hidden=hidden), RefinementSettings(), 0.1
    )
    middle = slice(11, 19)
    assert overlaps(knowing, centers, yaws)[middle].min() > 0.7
    assert (
        overlaps(knowing, centers, yaws)[middle].mean()
        > overlaps(trusting, centers, yaws)[middle].mean()
    )


def test_a_car_seen_only_from_behind_is_taken_for_a_car():
    centers = np.stack([np.full(20, 0.3), 12 + 0.9 * np.arange(20)], axis=1)
    yaws = np.full(20, -math.pi / 2)
    path = refine(sightings_of(centers, yaws), RefinementSettings(), 0.1)
    assert path.length == pytest.approx(4.2, abs=0.4)
    assert overlaps(path, centers, yaws).min() > 0.8


def test_a_length_whose_ends_are_hidden_is_not_shown():
    # The sensor would see along the car, but something in front of its nose and tail hides both.
    centers, yaws = straight(20, start=(-8.0, 14.0))
    hidden = np.zeros((20, 4), dtype=bool)
    hidden[:, :2] = True
    cut = [-SIZE[0] / 2 + 1.0] * 20
    part = refine(sightings_of(centers, yaws, cuts=cut, hidden=hidden), RefinementSettings(), 0.1)
    short = refine(sightings_of(centers, yaws, cuts=cut), RefinementSettings(), 0.1)
    assert short.length < 1.5
    assert part.length == pytest.approx(4.2, abs=0.4)


def test_a_pedestrian_is_not_taken_for_a_car():
    centers, yaws = straight(30, start=(-2.0, 8.0), step=(0.13, 0.0))
    path = refine(sightings_of(centers, yaws, size=(0.8, 0.6)), RefinementSettings(), 0.1)
    assert (path.length, path.width) == (pytest.approx(0.85, abs=0.1), pytest.approx(0.65, abs=0.1))


def test_one_sighting_gives_a_box_and_the_same_twice():
    centers, yaws = straight(1)
    seen = sightings_of(centers, yaws)
    first, second = (refine(seen, RefinementSettings(), 0.1) for _ in range(2))
    assert np.array_equal(first.center, second.center)
    assert np.isfinite([first.length, first.width, *first.yaw_rad]).all()


def test_a_small_world_refines_like_a_large_one():
    centers, yaws = straight(20)
    large = refine(sightings_of(centers, yaws), RefinementSettings(), 0.1)
    seen = sightings_of(centers, yaws)
    small = refine(
        Sightings(**{**seen.__dict__, "xz": 0.2 * seen.xz, "above_top_m": 0.2 * seen.above_top_m}),
        RefinementSettings().scaled(0.2),
        0.1,
    )
    assert small.center / 0.2 == pytest.approx(large.center, abs=1e-6)
    assert small.length / 0.2 == pytest.approx(large.length, abs=1e-6)


@pytest.mark.parametrize("count", [1, 2, 5, 10, 31])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.8, 0.9, 1.0])
def test_quantiles_are_those_of_numpy(count, share):
    values = np.random.default_rng(count).normal(size=count)
    assert quantile(values, share) == float(np.quantile(values, share))
