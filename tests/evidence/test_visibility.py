"""Visibility: boxes stop rays or let them pass, and every proposal gets a word on both modules."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learnt_worlds import label, learnt_world

from tcrdata import registry
from tcrdata.evidence import visibility
from tcrdata.evidence.ray_counts import ray_counts, rays_of
from tcrdata.executors import Serial
from tcrdata.ingest import frames_of
from tcrdata.plan import ordered_cues, speaks_anew
from tcrdata.store import Store, Unit
from tcrdata.types import BOX_COLUMNS, CueInput

CENTRE = np.zeros(3)


def counted(
    ends: list[list[float]], box: list[float], ground: list[int] | None = None
) -> tuple[int, int]:
    flags = np.zeros(len(ends), dtype=bool)
    flags[ground or []] = True
    rays = rays_of(np.array(ends, dtype=np.float32), flags, CENTRE)
    core = [*box[:3], box[3] / 2, box[4] / 2, box[5] / 2, box[6]]
    stopped, passed = ray_counts(rays, np.array([box]), np.array([core]), 0.2)
    return int(stopped[0]), int(passed[0])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_ray_ends_in_a_box_or_passes_or_says_nothing(side: float) -> None:
    """Ahead, and behind, where the azimuth jumps."""
    box = [0.0, 0.0, 10.0 * side, 4.0, 2.0, 2.0, 0.0]
    assert counted([[0.1, 0.1, 10.0 * side]], box) == (1, 0)
    assert counted([[0.3, 0.3, 30.0 * side]], box) == (0, 1)
    assert counted([[0.1, 0.1, 8.85 * side]], box) == (1, 0), "the margin"
    assert counted([[0.1, 0.1, 5.0 * side]], box) == (0, 0), "hidden"
    assert counted([[9.0, 0.1, 10.0 * side]], box) == (0, 0), "beside"
    assert counted([[0.1, 9.0, 10.0 * side]], box) == (0, 0), "below"


def test_rays_that_end_on_the_ground_have_passed_through_what_is_above_it() -> None:
    box = [0.0, 0.0, 10.0, 4.0, 2.0, 2.0, 0.0]
    assert counted([[0.0, 0.5, 11.0]], box, ground=[0]) == (0, 1)
    assert counted([[0.0, 0.4, 9.9]], box, ground=[0]) == (0, 0)


def test_a_ray_that_grazes_a_corner_says_nothing() -> None:
    box = [0.0, 0.0, 10.0, 2.0, 2.0, 2.0, np.pi / 4]
    assert counted([[3.0 * 1.0, 0.0, 30.0]], box) == (0, 0)
    assert counted([[3.0 * 0.5, 0.0, 30.0]], box) == (0, 1)


def test_counts_are_those_of_plain_geometry_over_all_rays() -> None:
    rng = np.random.default_rng(0)
    sensor = np.array([0.2, -0.1, 0.4])
    xyz = rng.uniform(-25, 25, (3000, 3)).astype(np.float32)
    boxes = np.column_stack(
        [rng.uniform(-12, 12, (6, 3)), rng.uniform(2, 6, (6, 3)), rng.uniform(-3, 3, 6)]
    )
    rays = rays_of(xyz, np.zeros(3000, bool), sensor)
    stopped, passed = ray_counts(rays, boxes, boxes, 0.0)
    way = np.linalg.norm(xyz - sensor, axis=1, keepdims=True)
    for number, box in enumerate(boxes):
        c, s = np.cos(box[6]), np.sin(box[6])
        axes = np.array([[c, 0, -s], [s, 0, c], [0, 1, 0]])
        slope, start = (xyz - sensor) / way @ axes.T, axes @ (sensor - box[:3])
        half = box[[3, 4, 5]] / 2
        faces = np.sort([(-half - start) / slope, (half - start) / slope], axis=0)
        enters, leaves = np.maximum(faces[0].max(axis=1), 0), faces[1].min(axis=1)
        met, ends = leaves >= enters, way[:, 0]
        assert stopped[number] == (met & (ends >= enters) & (ends <= leaves)).sum()
        assert passed[number] == (met & (ends > leaves)).sum() > 10


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The van and empty places as proposals of three sources; a track has a word on motion."""
    store = learnt_world(tmp_path_factory.mktemp("world"), frames=2, images=False)
    for round, source in ((1, "track"), (2, "detector")):
        unit = Unit(source, "kitti", sequence_of(store), round)
        with store.writer(unit, settings_hash="0", inputs={}) as writer:
            writer.append("proposals", proposals(store, source))
            if source == "track":
                writer.append("confidences", {
                    "proposal_id": ["track/van"], "frame": [0], "source": [source],
                    "module": ["track"], "confidence": [0.9], "raw_value": [5.0], "unit": ["m"],
                })  # fmt: skip
    return store


def sequence_of(store: Store) -> str:
    return str(store.read("sequences")["sequence"][0].as_py())


def proposals(store: Store, source: str) -> dict[str, Any]:
    van = label(sequence_of(store), 0, 0, True)
    nearer = {**van, "x_m": van["x_m"] * 0.6, "z_m": van["z_m"] * 0.6, "length_m": 1.0}
    boxes = {"van": van, "before": nearer, "above": {**van, "y_m": -40.0}}
    columns: dict[str, Any] = {n: [b[n] for b in boxes.values()] for n in BOX_COLUMNS}
    names = [f"{source}/{name}" for name in boxes]
    return columns | {
        "proposal_id": names, "frame": [0] * 3, "source": [source] * 3, "fit": [source] * 3,
        "region_id": names, "found": ["observed"] * 3, "metric_scale": [1.0] * 3,
        "range_m": [15.0] * 3, "number_of_points": [9, 0, 0],
        "votes_free_mean": [6.0, None, None], "votes_static_mean": [2.0, None, None],
    }  # fmt: skip


def measured(store: Store) -> dict[tuple[str, str], dict[str, Any]]:
    root = store.read("sequences")["root"][0].as_py()
    dataset = registry.find("datasets", "kitti").open_dataset(root)
    sequence = sequence_of(store)
    cue = CueInput(
        dataset.info(sequence), tuple(frames_of(store, "kitti", sequence)), dataset,
        store.tables("kitti", sequence, 2), visibility.Settings(), Serial(), 2,
    )  # fmt: skip
    rows = [
        dict(zip(batch.columns, values, strict=True))
        for batch in visibility.run(cue)
        for values in zip(*batch.columns.values(), strict=True)
    ]
    return {(row["proposal_id"], row["module"]): row for row in rows}


def test_every_proposal_of_every_source_gets_a_word(world: Store) -> None:
    rows = measured(world)
    for source in ("track", "detector"):
        van, before, above = (
            rows[f"{source}/{name}", "visibility"] for name in ("van", "before", "above")
        )
        assert van["raw_value"] > 20
        assert van["confidence"] > 0.1
        assert before["raw_value"] > 0
        assert before["confidence"] == 0.0
        assert (above["confidence"], above["raw_value"]) == (None, 0.0)
        assert van["source"] == source


def test_sources_without_a_word_on_motion_get_one_from_free_space(world: Store) -> None:
    rows = measured(world)
    assert rows["detector/van", "free_space"]["confidence"] == pytest.approx(0.75)
    assert rows["detector/before", "free_space"]["confidence"] is None
    assert ("track/van", "free_space") not in rows


def test_it_is_measured_in_each_later_round() -> None:
    assert speaks_anew("visibility")
    order = ordered_cues(["visibility", "objectness3d"])
    assert order.index("visibility") > order.index("detected_objects")
