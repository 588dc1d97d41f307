"""Templates fit where their points are, and follow a step finer than their voxels."""

from __future__ import annotations

import numpy as np
import pytest
from block_world import block, corners_agree, scene

from tcrdata.tracking.templates import CorrelationSettings, correlate, make_template, updated

OWN = CorrelationSettings()
BOX = block(1.0, 9.0, yaw=0.4)


def test_a_template_fits_its_own_points_best_where_they_are() -> None:
    shown = scene(0, {"a": BOX})
    template = make_template(BOX, shown.points, shown.features, OWN)
    assert template is not None
    pose = correlate(template, BOX, shown.points, shown.features, OWN)
    assert pose is not None
    corners_agree(pose.box, BOX, 0.02)
    assert pose.score == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("step", [(0.3, 0.0, 0.0), (-0.2, 0.0, 0.25), (0.1, -0.3, 0.0)])
def test_a_step_is_followed(step: tuple[float, float, float]) -> None:
    moved = BOX.copy()
    moved[:3] += step
    first, second = scene(0, {"a": BOX}), scene(1, {"a": moved})
    template = make_template(BOX, first.points, first.features, OWN)
    assert template is not None
    pose = correlate(template, BOX, second.points, second.features, OWN)
    assert pose is not None
    corners_agree(pose.box, moved, 0.12)


def test_a_neighbour_of_another_colour_does_not_draw_a_template_away() -> None:
    first = scene(0, {"a": BOX, "b": block(2.6, 9.0)})
    second = scene(1, {"b": block(1.6, 9.0)})  # a is gone, b comes near
    template = make_template(BOX, first.points, first.features, OWN)
    assert template is not None
    own = second.features.copy()
    own[:, 1:] = np.array([np.cos(2.0), np.sin(2.0)]) / np.sqrt(2)  # the second block's colour
    pose = correlate(template, BOX, second.points, own, OWN)
    assert pose is None or pose.score < 0.5


def test_no_points_no_template_and_no_pose() -> None:
    shown = scene(0, {"a": BOX})
    far = block(-30.0, 9.0)
    assert make_template(far, shown.points, shown.features, OWN) is None
    template = make_template(BOX, shown.points, shown.features, OWN)
    assert template is not None
    assert correlate(template, far, shown.points, shown.features, OWN) is None
    assert updated(template, far, shown.points, shown.features, OWN) is template


def test_features_of_another_kind_are_not_compared() -> None:
    """A frame whose image is missing has other channels."""
    shown = scene(0, {"a": BOX})
    template = make_template(BOX, shown.points, shown.features, OWN)
    assert template is not None
    for other in (shown.features[:, :2], np.repeat(shown.features, 2, axis=1)):
        assert correlate(template, BOX, shown.points, other, OWN) is None
        assert updated(template, BOX, shown.points, other, OWN) is template
