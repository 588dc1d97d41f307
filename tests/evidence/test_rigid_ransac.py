from __future__ import annotations

import numpy as np
from plane_world import motion

from tcrdata.evidence.rigid_ransac import RigidFit, fit_rigid, ransac_rigid

TRUE = motion(0.3, -0.05, 0.9, yaw=0.02)


def moved(points: np.ndarray) -> np.ndarray:
    return points @ TRUE[:3, :3].T + TRUE[:3, 3]


def find(start: np.ndarray, end: np.ndarray, seed: int = 1) -> RigidFit | None:
    return ransac_rigid(
        start, end, radius_m=0.25, draws=512, draw_size=8, scored=2000, seed=(seed, 0)
    )


def test_a_fit_of_exact_points_is_exact() -> None:
    start = np.random.default_rng(0).uniform(-20, 20, (50, 3))
    np.testing.assert_allclose(fit_rigid(start, moved(start)), TRUE, atol=1e-12)


def test_points_in_a_plane_do_not_turn_into_a_reflection() -> None:
    start = np.random.default_rng(0).uniform(-20, 20, (3, 50, 3))
    start[..., 1] = 1.7
    for fit in fit_rigid(start, moved(start)):
        np.testing.assert_allclose(fit, TRUE, atol=1e-9)


def test_thirty_percent_outliers_leave_the_motion_exact() -> None:
    random = np.random.default_rng(2)
    start = random.uniform(-20, 20, (1000, 3))
    end = moved(start)
    end[:300] += random.uniform(1, 5, (300, 3))
    fit = find(start, end)
    assert fit is not None
    np.testing.assert_allclose(fit.to_T_from, TRUE, atol=1e-10)
    assert not fit.inliers[:300].any()
    assert fit.inliers[300:].all()
    assert fit.residual_m < 1e-10


def test_noise_is_averaged_by_the_refit() -> None:
    random = np.random.default_rng(3)
    start = random.uniform(-20, 20, (3000, 3))
    end = moved(start) + random.normal(0, 0.05, (3000, 3))
    end[:900] += random.uniform(1, 5, (900, 3))
    fit = find(start, end)
    assert fit is not None
    # One draw of 8 points errs by about 0.05 / sqrt(8) m; 2,100 inliers by 0.001 m.
    assert np.linalg.norm(fit.to_T_from[:3, 3] - TRUE[:3, 3]) < 0.005
    assert 0.07 < fit.residual_m < 0.1  # sqrt(3) * 0.05


def test_the_same_seed_gives_the_same_bits() -> None:
    random = np.random.default_rng(4)
    start = random.uniform(-20, 20, (400, 3))
    end = moved(start) + random.normal(0, 0.1, (400, 3))
    first, second = find(start, end), find(start, end)
    assert first is not None
    assert second is not None
    assert first.to_T_from.tobytes() == second.to_T_from.tobytes()


def test_too_few_displacements_give_no_motion() -> None:
    start = np.random.default_rng(5).uniform(-20, 20, (7, 3))
    assert find(start, moved(start)) is None


def test_displacements_without_agreement_give_no_motion() -> None:
    random = np.random.default_rng(6)
    start = random.uniform(-50, 50, (30, 3))
    assert find(start, random.uniform(-50, 50, (30, 3))) is None
