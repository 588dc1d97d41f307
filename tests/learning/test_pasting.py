"""Copies of labelled objects stand in their boxes, on free ground, and hide what is behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcrdata.geometry.boxes import points_in_box
from tcrdata.learning.augmentation import SweepAugmentation
from tcrdata.learning.clouds import Cloud, owners, points_of_labels
from tcrdata.learning.pasting import labelled_objects, with_copies
from tcrdata.networks.center_targets import LabelBoxes
from tcrdata.networks.grids import Region

REGION = Region(20.0, 0.0, 40.0, 0.5)
FLOOR_M = 1.7
CAR = np.array([1.0, FLOOR_M - 0.75, -9.0, 4.2, 1.8, 1.5, 0.5])
SETTINGS = SweepAugmentation(pasted=4, pasted_stretch=0.1)


def cloud_of(xyz: np.ndarray, labels: LabelBoxes) -> Cloud:
    height, xyz = (FLOOR_M - xyz[:, 1]).astype(np.float32), xyz.astype(np.float32)
    ground = height < 0.05
    return Cloud(xyz, height, ground, np.arange(len(xyz)), owners(xyz, ground, labels))


def world(walls: np.ndarray | None = None) -> tuple[Cloud, LabelBoxes]:
    """A level ground, a car behind the sensor that only the whole sweep shows, and walls."""
    rng = np.random.default_rng(0)
    ground = np.column_stack(
        [rng.uniform(-30, 30, 9000), np.full(9000, FLOOR_M), rng.uniform(-30, 45, 9000)]
    )
    on_car = CAR[:3] + rng.uniform(-0.6, 0.6, (300, 3))
    parts = [ground, on_car, *([] if walls is None else [walls])]
    labels = labels_of(CAR)
    return cloud_of(np.vstack(parts), labels), labels


def labels_of(*boxes: np.ndarray) -> LabelBoxes:
    count = len(boxes)
    return LabelBoxes(np.array(boxes), np.ones(count, bool), np.ones(count, bool))


def pasted(seed: int, walls: np.ndarray | None = None) -> tuple[Cloud, LabelBoxes, Cloud]:
    whole, labels = world(walls)
    inside = REGION.cells(whole.xyz[:, 0], whole.xyz[:, 2])[1]
    rng = np.random.default_rng(seed)
    made, boxes = copied(whole, whole.chosen(inside), labels, rng)
    return made, boxes, whole


def copied(
    whole: Cloud, shown: Cloud, labels: LabelBoxes, rng: np.random.Generator
) -> tuple[Cloud, LabelBoxes]:
    counts = points_of_labels(shown.owner, len(labels))
    return with_copies(shown, labels, labelled_objects(whole), counts, REGION, SETTINGS, rng)


@pytest.mark.parametrize("seed", range(4))
def test_copies_stand_in_their_boxes_on_the_ground_of_the_region(seed: int) -> None:
    made, labels, whole = pasted(seed)
    assert 2 <= len(labels) <= 1 + SETTINGS.pasted
    on_car = set(np.flatnonzero(points_in_box(whole.xyz, CAR, 0.1) & ~whole.ground))
    copied = np.isin(made.origin, list(on_car))
    in_a_box = np.zeros(len(copied), bool)
    for box in labels.boxes[1:]:
        assert REGION.cells(box[:1], box[2:3])[1].all()
        assert box[1] + box[5] / 2 == pytest.approx(FLOOR_M, abs=1e-3)
        assert np.hypot(box[0], box[2]) >= np.hypot(CAR[0], CAR[2]) - 1e-6
        own = points_in_box(made.xyz, box, 0.1) & copied
        assert own.sum() >= 4
        in_a_box |= own
    assert np.array_equal(in_a_box, copied)
    assert labels.positive.all()
    assert labels.moving.all()


def test_large_things_are_copied_as_often_as_small_ones_where_there_is_little_room() -> None:
    rng = np.random.default_rng(3)
    posts = np.column_stack([rng.uniform(-20, 20, 160), rng.uniform(0, 40, 160)]).repeat(4, axis=0)
    posts = np.insert(posts, 1, FLOOR_M - 0.4, axis=1) + rng.uniform(-0.1, 0.1, (640, 3))
    person = np.array([-3.0, FLOOR_M - 0.8, -8.0, 0.6, 0.6, 1.6, 0.0])
    on_person = person[:3] + rng.uniform(-0.3, 0.3, (300, 3))
    labels = labels_of(CAR, person)
    whole = cloud_of(np.vstack([world()[0].xyz, posts, on_person]), labels)
    shown = whole.chosen(np.flatnonzero(REGION.cells(whole.xyz[:, 0], whole.xyz[:, 2])[1]))
    lengths = np.concatenate([
        copied(whole, shown, labels, np.random.default_rng(seed))[1].boxes[2:, 3]
        for seed in range(10)
    ])  # fmt: skip
    assert len(lengths) > 20
    assert 0.35 < (lengths > 2.0).mean() < 0.65


def test_what_is_farther_shows_fewer_points() -> None:
    pairs = []
    for seed in range(8):
        made, labels, _ = pasted(seed)
        for box in labels.boxes[1:]:
            shown = (points_in_box(made.xyz, box, 0.1) & ~made.ground).sum()
            pairs.append((np.hypot(box[0], box[2]), shown))
    ranges, shown = np.array(pairs).T
    assert shown[ranges < 11].mean() > 1.5 * shown[ranges > 15].mean()


def test_nothing_is_pasted_onto_what_stands_or_behind_a_wall() -> None:
    step = np.arange(-25.0, 25.0, 0.02)
    wall = np.vstack(
        [np.column_stack([step, np.full(len(step), y), np.full(len(step), 6.0)])
         for y in np.arange(-1.0, 1.6, 0.05)]
    )  # fmt: skip
    made, labels, _ = pasted(3, wall)
    for box in labels.boxes[1:]:
        assert abs(np.arctan2(box[0], box[2])) > np.arctan2(18.0, 6.0)
    assert len(made.xyz) > 0


def test_a_copy_hides_what_is_behind_it_and_nothing_else() -> None:
    made, labels, whole = pasted(1)
    inside = np.flatnonzero(REGION.cells(whole.xyz[:, 0], whole.xyz[:, 2])[1])
    hidden = whole.xyz[np.setdiff1d(inside, made.origin)]
    assert len(hidden) > 5
    azimuth, ranges = np.arctan2(hidden[:, 0], hidden[:, 2]), np.hypot(hidden[:, 0], hidden[:, 2])
    behind = np.zeros(len(hidden), bool)
    for box in labels.boxes[1:]:
        off, distance = azimuth - np.arctan2(box[0], box[2]), np.hypot(box[0], box[2])
        behind |= (np.abs(off) < 1.2 / distance) & (ranges > distance - 1.0)
    assert behind.all()


def test_no_copy_hides_another_object_nor_another_copy() -> None:
    """Low things all around, behind where copies come: each keeps more than half of its points."""
    low = [np.array([22 * np.sin(t), FLOOR_M - 0.3, 22 * np.cos(t), 1.0, 1.0, 0.5, 0.0])
           for t in np.linspace(-0.7, 0.7, 12)]  # fmt: skip
    rng = np.random.default_rng(5)
    points = [box[:3] + rng.uniform(-0.2, 0.2, (60, 3)) for box in low]
    dense = CAR[:3] + rng.uniform(-0.7, 0.7, (4000, 3))
    labels = labels_of(CAR, *low)
    whole = cloud_of(np.vstack([world()[0].xyz, *points, dense]), labels)
    shown = whole.chosen(np.flatnonzero(REGION.cells(whole.xyz[:, 0], whole.xyz[:, 2])[1]))
    before = points_of_labels(shown.owner, len(labels))
    erased = shown.chosen((shown.owner < 1) | (rng.random(len(shown.owner)) > 0.3))
    low_points = erased.origin[erased.owner > 0]
    nobodys = replace(erased, owner=np.minimum(erased.owner, 0))
    car, hidden = labelled_objects(whole)[:1], 0
    for seed in range(12):
        made, _ = with_copies(
            erased, labels, car, before, REGION, SETTINGS, np.random.default_rng(seed)
        )
        left = points_of_labels(made.owner, len(labels))
        assert (left[1 : len(labels)] > before[1:] / 2).all()
        assert (left[len(labels) :] >= 4).all()
        made, _ = with_copies(
            nobodys, labels_of(CAR), car, before[:1], REGION, SETTINGS, np.random.default_rng(seed)
        )
        hidden += int((erased.owner > 0).sum() - np.isin(made.origin, low_points).sum())
    assert hidden > 20, "unlabelled, they are hidden"


def test_without_an_object_there_is_nothing_to_paste() -> None:
    cloud, labels = world()
    none = LabelBoxes(labels.boxes, np.zeros(1, bool), np.zeros(1, bool))
    cloud = replace(cloud, owner=owners(cloud.xyz, cloud.ground, none))
    assert labelled_objects(cloud) == []
    same, unchanged = copied(cloud, cloud, none, np.random.default_rng(0))
    assert same is cloud
    assert unchanged is none
