"""Samples: labels stay on their objects, and only what is sure is background."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learnt_worlds import SELECTION, learnt_world

from tcrdata import registry
from tcrdata.errors import SettingsError
from tcrdata.geometry.boxes import points_in_box
from tcrdata.learning.augmentation import (
    ImageAugmentation,
    SweepAugmentation,
    SweepChange,
    drawn_change,
    erased_points,
    image_placement,
    jittered,
)
from tcrdata.learning.clouds import Cloud, owners
from tcrdata.learning.detector_samples import (
    DetectorSamples,
    cloud_of,
    known_background,
    unsure_points,
)
from tcrdata.learning.frames import open_frames
from tcrdata.learning.segmenter_samples import SegmenterSamples, pixel_labels
from tcrdata.networks.center_targets import LabelBoxes
from tcrdata.networks.grids import Region

REGION = Region(8.0, 0.0, 16.0, 0.5)
CAR = np.array([1.3, 0.9, 9.1, 4.2, 1.8, 1.5, 0.5])


def labels_of(*boxes: np.ndarray) -> LabelBoxes:
    count = len(boxes)
    return LabelBoxes(np.array(boxes).reshape(-1, 7), np.ones(count, bool), np.ones(count, bool))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    store = learnt_world(tmp_path_factory.mktemp("world"), frames=3)
    return {
        query: open_frames(store, query, parameters={"selection_id": SELECTION})[1]
        for query in ("detector", "segmenter")
    }


@pytest.mark.parametrize(
    "change",
    [
        SweepChange(turn_rad=0.7),
        SweepChange(mirror=-1.0),
        SweepChange(scale=1.3),
        SweepChange(turn_rad=-2.0, mirror=-1.0, scale=0.9),
    ],
)
def test_points_stay_in_their_box_however_both_are_moved(change: SweepChange) -> None:
    rng = np.random.default_rng(0)
    xyz = (CAR[:3] + rng.uniform(-3, 3, (400, 3))).astype(np.float32)
    (box,) = change.labels(labels_of(CAR)).boxes
    inside = points_in_box(xyz, CAR)
    assert 5 < inside.sum() < 395
    assert np.array_equal(points_in_box(change.points(xyz), box), inside)


def test_a_mirrored_object_heads_the_other_way() -> None:
    (box,) = SweepChange(mirror=-1.0).labels(labels_of(CAR)).boxes
    before = np.array([np.cos(CAR[6]), -np.sin(CAR[6])])
    assert [np.cos(box[6]), -np.sin(box[6])] == pytest.approx(before * [-1, 1])


def test_nothing_changes_when_augmentation_is_off() -> None:
    rng = np.random.default_rng(0)
    assert drawn_change(SweepAugmentation(enabled=False), rng) == SweepChange()


def test_an_erased_square_never_takes_the_whole_object() -> None:
    rng = np.random.default_rng(1)
    xyz = (CAR[:3] + rng.uniform(-0.7, 0.7, (200, 3))).astype(np.float32)
    wide, narrow = xyz[:, :2] * 100, xyz[:, :2]
    settings = SweepAugmentation(erased_px=60.0)
    cloud = cloud_around(xyz, labels_of(CAR))
    gone = erased_points(cloud, wide.astype(float), settings, rng)
    assert 0 < gone.sum() < 100
    assert not erased_points(cloud, narrow.astype(float), settings, rng).any()


def test_an_erased_square_never_takes_another_whole_object() -> None:
    """A small object is seen beside the middle of a large one: what would erase it is left."""
    small = np.array([1.3, 0.9, 20.0, 0.8, 0.8, 1.5, 0.0])
    rng = np.random.default_rng(2)
    spread = rng.uniform(-1, 1, (400, 3)) * CAR[[3, 5, 4]] / 2
    xyz = np.vstack([CAR[:3] + spread, small[:3] + rng.uniform(-0.3, 0.3, (30, 3))])
    pixels = np.where((np.arange(430) < 400)[:, None], (xyz[:, :2] - CAR[:2]) * 30, 0.0)
    pixels[400:] = rng.uniform(-4, 4, (30, 2))
    settings = SweepAugmentation(erased_px=20.0)
    alone = cloud_around(xyz.astype(np.float32), labels_of(CAR))
    both = cloud_around(xyz.astype(np.float32), labels_of(CAR, small))
    taken = 0
    for seed in range(10):
        gone = erased_points(both, pixels, settings, np.random.default_rng(seed))
        assert gone[400:].sum() < 15
        taken += erased_points(alone, pixels, settings, np.random.default_rng(seed))[400:].sum()
    assert taken > 100, "unlabelled, it goes"


def cloud_around(xyz: np.ndarray, labels: LabelBoxes) -> Cloud:
    ground = np.zeros(len(xyz), bool)
    return Cloud(xyz, xyz[:, 1], ground, np.arange(len(xyz)), owners(xyz, ground, labels))


def background(kind: str, unsure: list[list[float]]) -> np.ndarray:
    row = {"negatives": kind, "near_m": 1.0, "unsure_reach_m": 2.0}
    points = np.array(unsure, dtype=np.float32).reshape(-1, 3)
    return known_background(row, points, labels_of(CAR), REGION)


def test_background_is_what_is_sure_and_what_surrounds_labels() -> None:
    lonely, beside = [-5.0, 0.5, 4.0], [2.4, 0.5, 9.0]
    known = background("sure", [lonely, beside])
    assert not known[8, 6], "somebody unlabelled may stand there"
    assert not known[8, 9], "or here: objects are that wide"
    assert known[8, 12]
    assert known[18, 20], "beside a label it is known"
    assert background("sure", []).all()


def test_the_papers_background_surrounds_labels_alone() -> None:
    known = background("near", [])
    assert known[18, 18]
    assert not known[2, 2]
    assert background("everywhere", [[0.0, 0.0, 5.0]]).all()
    with pytest.raises(SettingsError, match="near, sure, everywhere"):
        background("nowhere", [])


def test_what_was_seen_standing_is_sure_and_what_moves_unlabelled_is_not(
    rows: dict[str, dict[str, Any]],
) -> None:
    row = rows["detector"]
    nobody = LabelBoxes(np.empty((0, 7)), np.empty(0, bool), np.empty(0, bool))
    unsure = unsure_points(row, cloud_of(row, nobody), nobody)
    assert 0 < unsure.sum() < 0.5 * len(unsure)
    assert not (unsure & row["ground"]).any()
    van = next(label for label in row["labels"] if label["positive"])
    names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
    box = np.array([van[name] for name in names])
    labels = labels_of(box)
    assert not unsure_points(row, cloud_of(row, labels), labels)[unsure].any()


@pytest.mark.parametrize("network", ["birds_eye", "release_birds_eye", "volume"])
def test_every_detector_gets_its_input_and_targets(
    rows: dict[str, dict[str, Any]], network: str
) -> None:
    module = registry.find("networks", network)
    settings = module.Settings(cell_m=0.5)
    made = DetectorSamples(network, settings)(rows["detector"], np.random.default_rng(0))
    region = settings.region
    assert made["input"].shape[-2:] == (region.rows, region.columns)
    assert made["center"].shape[-2:] == (
        region.rows // settings.stride,
        region.columns // settings.stride,
    )
    assert made["key"].startswith("kitti/")
    assert all(np.isfinite(v).all() for v in made.values() if isinstance(v, np.ndarray))


def test_the_label_is_where_the_van_is(rows: dict[str, dict[str, Any]]) -> None:
    settings = registry.find("networks", "birds_eye").Settings()
    samples = DetectorSamples("birds_eye", settings, SweepAugmentation(enabled=False))
    made = samples(rows["detector"], np.random.default_rng(0))
    van = next(label for label in rows["detector"]["labels"] if label["positive"])
    row, column = np.argwhere(made["center"][0] == 1.0)[0]
    assert (column + 0.5) * 0.5 - 20 == pytest.approx(van["x_m"], abs=0.26)
    assert (row + 0.5) * 0.5 == pytest.approx(van["z_m"], abs=0.26)
    assert made["direction_weight"].max() == 1.0


def test_pixels_of_labels_are_objects_and_a_band_and_what_stands_are_not(
    rows: dict[str, dict[str, Any]],
) -> None:
    row = {**rows["segmenter"], "band_px": 3.0}
    objects, known = pixel_labels(row)
    assert objects.any()
    assert known[objects].all()
    assert 0.05 < known.mean() < 0.95
    ignored = next(label for label in row["labels"] if not label["positive"])
    v, u = (
        22.0 + 93.0 * ignored["y_m"] / ignored["z_m"],
        79.5 + 93.0 * ignored["x_m"] / ignored["z_m"],
    )
    assert not objects[int(v), int(u)]


def test_a_crop_and_its_pixel_labels_fit(rows: dict[str, dict[str, Any]]) -> None:
    samples = SegmenterSamples(height_px=48, width_px=160, scale=1.0)
    made = samples(rows["segmenter"], np.random.default_rng(3))
    assert made["input"].shape == (3, 48, 160)
    assert made["objectness"].shape == made["objectness_weight"].shape == (1, 12, 40)
    assert 0 <= made["input"].min() <= made["input"].max() <= 1


def test_an_image_keeps_its_place_when_nothing_is_drawn() -> None:
    rng = np.random.default_rng(0)
    placed = image_placement(ImageAugmentation(enabled=False), (48, 160), (24, 80), 0.5, rng)
    assert placed == pytest.approx(np.array([[0.5, 0, 0], [0, 0.5, 0]]))


def test_what_is_painted_over_is_said() -> None:
    image = np.full((40, 60, 3), 0.5, np.float32)
    settings = ImageAugmentation(occlusions=8, noise=0.0, brightness=0.0, contrast=0.0)
    painted, hidden = jittered(image.copy(), settings, np.random.default_rng(2))
    assert hidden.any()
    assert np.abs(painted[~hidden] - 0.5).max() < 1e-6
