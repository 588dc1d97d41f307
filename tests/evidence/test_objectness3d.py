"""3D objectness: a trained detector's boxes, and its word on the boxes of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learnt_worlds import SELECTION, TINY, label, learnt_world

from tcrdata import registry
from tcrdata.errors import EvidenceError, StoreError
from tcrdata.evidence import objectness3d
from tcrdata.evidence.objectness_boxes import footprint_heat, on_the_ground
from tcrdata.executors import Serial
from tcrdata.ingest import frames_of
from tcrdata.learning.runs import plan_recipe, run_training
from tcrdata.networks.grids import Region
from tcrdata.networks.trained import to_bytes, trained_network
from tcrdata.store import Store, Unit
from tcrdata.types import CueInput

STEPS = {**TINY, "steps": "60", "checkpoint_steps": "60", "augmentation.enabled": "false"}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Store:
    store = learnt_world(tmp_path_factory.mktemp("world"), frames=3, images=False)
    run_training(store, plan_recipe("detector", STEPS), selection_id=SELECTION)
    with store.writer(Unit("tracks", "kitti", sequence_of(store), 1), settings_hash="0",
                      inputs={}) as writer:  # fmt: skip
        writer.append("proposals", known_columns(store))
    return store


def sequence_of(store: Store) -> str:
    return str(store.read("sequences")["sequence"][0].as_py())


def known_columns(store: Store) -> dict[str, Any]:
    """The van of frame 0, and a place far outside."""
    van = label(sequence_of(store), 0, 0, True)
    boxes = [van, {**van, "z_m": 90.0}]
    names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
    columns: dict[str, Any] = {name: [box[name] for box in boxes] for name in names}
    return columns | {
        "proposal_id": ["van", "far"], "frame": [0, 0], "source": ["track"] * 2,
        "fit": ["track"] * 2, "region_id": ["van", "far"], "found": ["observed"] * 2,
        "metric_scale": [1.0] * 2, "range_m": [15.0, 90.0], "number_of_points": [9, 9],
    }  # fmt: skip


def measured(store: Store, round: int = 2, **settings: Any) -> dict[str, list[dict[str, Any]]]:
    """What the cue gives; of one look, since the network of these tests knows no other."""
    settings = {"turn_rad": 0.0, **settings}
    sequence = sequence_of(store)
    dataset = registry.find("datasets", "kitti").open_dataset(
        store.read("sequences")["root"][0].as_py()
    )
    cue = CueInput(
        dataset.info(sequence), tuple(frames_of(store, "kitti", sequence)), dataset,
        store.tables("kitti", sequence, round), objectness3d.Settings(**settings), Serial(), round,
    )  # fmt: skip
    rows: dict[str, list[dict[str, Any]]] = {"proposals": [], "confidences": []}
    for batch in objectness3d.run(cue):
        names = list(batch.columns)
        rows[batch.table] += [
            dict(zip(names, values, strict=True))
            for values in zip(*batch.columns.values(), strict=True)
        ]
    return rows


@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_what_was_labelled_is_found_again(world: Store, turn_rad: float) -> None:
    rows = measured(world, turn_rad=turn_rad)
    for frame in range(3):
        found = [row for row in rows["proposals"] if row["frame"] == frame]
        van = label(sequence_of(world), frame, 0, True)
        off = [np.hypot(row["x_m"] - van["x_m"], row["z_m"] - van["z_m"]) for row in found]
        assert min(off) < 1.0
        best = found[int(np.argmin(off))]
        assert (best["source"], best["fit"]) == ("detector", "center_net")
        assert best["y_m"] == pytest.approx(van["y_m"], abs=0.5)
        assert best["number_of_points"] > 20
        assert best["votes_free_mean"] > 3


def test_every_box_gets_a_confidence_its_own_and_others(world: Store) -> None:
    rows = measured(world)
    values = {row["proposal_id"]: row["confidence"] for row in rows["confidences"]}
    assert {row["proposal_id"] for row in rows["proposals"]} | {"van", "far"} == set(values)
    assert values["van"] > 0.3
    assert values["far"] is None
    assert {row["module"] for row in rows["confidences"]} == {"objectness_3d"}


def test_the_same_model_gives_the_same_rows(world: Store) -> None:
    assert measured(world) == measured(world)


def test_another_stores_model_measures_here_too(world: Store, tmp_path: Path) -> None:
    fresh = learnt_world(tmp_path, frames=1, images=False)
    assert measured(fresh, round=1, model_store=world.url)["proposals"] != []


def test_a_round_without_an_earlier_model_says_so(world: Store) -> None:
    with pytest.raises(EvidenceError, match="no trained detector for round 1: run `tcrdata train"):
        measured(world, round=1)
    with pytest.raises(EvidenceError, match="no trained detector 'abc'"):
        measured(world, model="abc")


def test_weights_of_another_architecture_are_refused() -> None:
    module = registry.find("networks", "birds_eye")
    small = module.make_network(module.Settings(widths=(8, 8, 8)))
    data = to_bytes(small.state_dict())
    with pytest.raises(StoreError, match=r"model m: the checkpoint is of another architecture"):
        trained_network("birds_eye", {}, data, "model m")
    with pytest.raises(StoreError, match=r"model m: 7 bytes that are no weights"):
        trained_network("birds_eye", {}, b"garbage", "model m")


def test_boxes_are_set_on_the_ground_around_them() -> None:
    xyz = np.array([[0.0, 1.2, 10.0], [0.0, 2.0, 30.0]], dtype=np.float32)
    height = np.array([0.5, 0.0], dtype=np.float32)
    boxes = np.array([[0, np.nan, 10, 4, 2, 1.5, 0], [0, 7.0, 10, 4, 2, 1.5, 0]], dtype=float)
    assert on_the_ground(boxes, xyz, height)[:, 1] == pytest.approx([1.7 - 0.75, 7.0])


def test_the_largest_heat_in_the_footprint_counts() -> None:
    region = Region(4.0, 0.0, 8.0, 1.0)
    heat = np.zeros((8, 8), np.float32)
    heat[5, 4], heat[0, 0] = 0.8, 1.0
    boxes = np.array([[0.0, 1, 4.0, 1.0, 4.0, 1.5, 0.0], [0, 1, 40, 4, 2, 1, 0]], dtype=float)
    assert footprint_heat(heat, boxes, region) == [pytest.approx(0.8), None]


def test_points_have_the_features_that_the_heads_get(world: Store) -> None:
    """Templates are correlated in them: alike at one place, and none outside of the region."""
    from tcrdata.evidence.detector_features import detector_features
    from tcrdata.evidence.models import ModelChoice, read_model
    from tcrdata.evidence.point_rows import read_encoded
    from tcrdata.track_plans import detector_of

    sequence = sequence_of(world)
    dataset = registry.find("datasets", "kitti").open_dataset(
        world.read("sequences")["root"][0].as_py()
    )
    frame = next(iter(frames_of(world, "kitti", sequence)))
    cloud = dataset.read_points(frame)
    tables = world.tables("kitti", sequence, 1)
    model = read_model(world, ModelChoice("detector", detector_of(world, 1), "", 1))
    known = {name: read_encoded(tables, frame.frame, name) for name in objectness3d.EVIDENCE}
    found = detector_features(model, frame, cloud, known, 1.0)
    assert found is not None
    assert len(found) == len(cloud)
    assert found.shape[1] > 2
    far = np.abs(cloud.xyz[:, 0]) > 60
    assert not found[far].any()
    near = (np.abs(cloud.xyz[:, 0]) < 5) & (cloud.xyz[:, 2] > 5) & (cloud.xyz[:, 2] < 20)
    assert np.ptp(found[near], axis=0).max() > 0
    assert detector_features(model, frame, cloud, {}, 1.0) is None
    assert detector_of(world, 1) == model.model_id
    assert detector_of(world, 0) == ""
