from __future__ import annotations

import math

import numpy as np
import pytest

from tcrdata.geometry.raycasting import Primitives, cast, count_pixels, place


def one(
    shape: str,
    half_size: tuple[float, float, float],
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotation: np.ndarray | None = None,
) -> Primitives:
    pose = np.eye(4)
    pose[:3, 3] = centre
    if rotation is not None:
        pose[:3, :3] = rotation
    return place([shape], [half_size], [pose], [0])  # type: ignore[list-item]


def rays(seed: int, count: int = 4000) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)) * 0.3 + (0.0, 0.0, -1.0)


def about_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


ORIGIN = np.array([0.2, -0.1, 5.0])


def test_a_plane_is_met_where_its_equation_says() -> None:
    directions = rays(0)
    times, hits = cast(one("plane", (0.0, 0.0, 0.0)), ORIGIN, directions)
    down = directions[:, 2] < 0
    assert down.sum() > 1000
    np.testing.assert_allclose(times[down], -5.0 / directions[down, 2], rtol=1e-12)
    assert np.all(np.isinf(times[~down]))
    assert np.array_equal(hits >= 0, down)


def test_an_uneven_plane_is_met_on_its_surface() -> None:
    directions = rays(1)
    times, hits = cast(one("plane", (20.0, 0.0, 0.05)), ORIGIN, directions)
    steep = (hits >= 0) & (directions[:, 2] < -0.2)
    x, y, z = (ORIGIN + times[steep, None] * directions[steep]).T
    k = 2 * np.pi / 20.0
    np.testing.assert_allclose(z, 0.025 * (np.sin(k * x) + np.sin(1.3 * k * y + 1)), atol=1e-6)
    assert np.ptp(z) > 0.04


def test_a_sphere_is_met_where_the_quadratic_says() -> None:
    directions = rays(2)
    centre, radius = np.array([0.3, 0.4, 1.0]), 1.3
    times, hits = cast(one("sphere", (radius,) * 3, tuple(centre)), ORIGIN, directions)
    apart = ORIGIN - centre
    a, b = (directions**2).sum(axis=1), directions @ apart
    root = b**2 - a * (apart @ apart - radius**2)
    expected = np.where(root >= 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    expected[expected < 0] = np.inf
    assert 100 < (hits == 0).sum() < len(directions) - 100
    np.testing.assert_allclose(times, expected, rtol=1e-9)


@pytest.mark.parametrize("shape", ["box", "cylinder", "cone"])
@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2, math.pi])
def test_a_hit_lies_on_the_surface_and_nothing_lies_before_it(shape: str, angle: float) -> None:
    half = (0.8, 0.8, 1.1) if shape != "box" else (0.5, 0.8, 1.1)
    centre, rotation = np.array([0.2, 0.3, 0.5]), about_x(angle)
    directions = rays(3)
    times, hits = cast(one(shape, half, tuple(centre), rotation), ORIGIN, directions)

    def inside(t: np.ndarray, which: np.ndarray) -> np.ndarray:
        points = (ORIGIN + t[:, None] * directions[which] - centre) @ rotation / half
        radius = np.hypot(points[:, 0], points[:, 1])
        if shape == "box":
            return np.abs(points).max(axis=1) < 1
        limit = 1.0 if shape == "cylinder" else 0.5 * (1 - points[:, 2])
        return (np.abs(points[:, 2]) < 1) & (radius < limit)

    hit, missed = np.flatnonzero(hits == 0), np.flatnonzero(hits < 0)
    assert len(hit) > 100
    assert len(missed) > 100
    assert inside(times[hit] + 1e-6, hit).mean() > 0.999
    for share in np.linspace(0.0, 1.0 - 1e-6, 60):
        assert not inside(times[hit] * share, hit).any()
    for t in np.linspace(2.0, 9.0, 120):
        assert not inside(np.full(len(missed), t), missed).any()


def test_the_nearest_shape_wins_and_the_limit_counts() -> None:
    shapes = one("plane", (0, 0, 0)).join(one("sphere", (1, 1, 1), (0, 0, 2)))
    shapes = shapes.join(one("box", (1, 1, 0.1), (0, 0, 4)))
    straight = np.array([[0.0, 0.0, -1.0]])
    for origin, t, shape in ((6.0, 1.9, 2), (3.5, 0.5, 1), (0.5, 0.5, 0)):
        times, hits = cast(shapes, (0, 0, origin), straight)
        assert hits[0] == shape
        assert times[0] == pytest.approx(t)
    times, hits = cast(shapes, (0, 0, 6.0), straight, 1.5)
    assert hits[0] == -1
    assert np.isinf(times[0])


def test_bundles_of_rays_find_what_single_rays_find() -> None:
    random = np.random.default_rng(4)
    poses = np.tile(np.eye(4), (80, 1, 1))
    poses[:, :3, 3] = random.uniform(-6, 6, (80, 3))
    kinds = [("sphere", "box", "cylinder", "cone")[n % 4] for n in range(80)]
    shapes = place(kinds, random.uniform(0.1, 0.8, (80, 3)), poses, range(80))  # type: ignore[arg-type]
    directions = random.normal(size=(640, 3))
    times, hits = cast(shapes, (0, 0, 0), directions)
    alone = [cast(shapes, (0, 0, 0), row[None]) for row in directions]
    assert (hits >= 0).sum() > 50
    assert np.array_equal(hits, [h[0] for _, h in alone])
    assert np.array_equal(times, [t[0] for t, _ in alone])


def test_pixels_of_a_half_hidden_box_are_counted() -> None:
    # Seen from above at 10 m with 100 px a radian: the far box is 20 px wide, half of it hidden.
    shapes = place(
        ["box", "box"],
        [(1.0, 1.0, 0.1), (2.0, 3.0, 0.1)],
        [np.eye(4), np.eye(4) + np.array([[0, 0, 0, 2.0], [0] * 4, [0, 0, 0, 4.0], [0] * 4])],
        [0, 1],
    )
    looking_down = np.array([[0.01, 0, -0.5], [0, 0.01, -0.5], [0, 0, -1.0]])
    windows = np.array([[0, 0, 100, 100], [0, 0, 0, 0]])
    visible, whole = count_pixels(shapes, (0.001, 0.001, 10.1), looking_down, windows)
    assert whole[0] == 400
    assert visible[0] == 200
    assert whole[1] == 0
