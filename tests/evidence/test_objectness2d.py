"""2D objectness: a segmenter's word on every proposal that shows in the image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from learnt_worlds import SELECTION, label, learnt_world

from tcrdata import registry
from tcrdata.errors import EvidenceError
from tcrdata.evidence import objectness2d
from tcrdata.executors import Serial
from tcrdata.ingest import frames_of
from tcrdata.learning.runs import plan_recipe, run_training
from tcrdata.store import Store, Unit
from tcrdata.types import BOX_COLUMNS, CueInput

STEPS = {"steps": "2", "batch": "1", "workers": "0", "network.width": "8"}


def sequence_of(store: Store) -> str:
    return str(store.read("sequences")["sequence"][0].as_py())


def world(folder: Path, images: bool) -> Store:
    """A drive with the van and a place far outside as proposals, of rounds 1 and 2."""
    store = learnt_world(folder, frames=2, images=images)
    sequence = sequence_of(store)
    for round in (1, 2):
        van = label(sequence, 0, 0, True)
        boxes = [van, {**van, "z_m": 90.0}]
        columns: dict[str, Any] = {name: [box[name] for box in boxes] for name in BOX_COLUMNS}
        columns |= {
            "proposal_id": [f"van{round}", f"far{round}"], "frame": [0, 0],
            "source": ["track"] * 2, "fit": ["track"] * 2, "region_id": ["van", "far"],
            "found": ["observed"] * 2, "metric_scale": [1.0] * 2, "range_m": [15.0, 90.0],
            "number_of_points": [9, 9],
        }  # fmt: skip
        unit = Unit("tracks", "kitti", sequence, round)
        with store.writer(unit, settings_hash="0", inputs={}) as writer:
            writer.append("proposals", columns)
    return store


def measured(store: Store) -> list[Any]:
    sequence = sequence_of(store)
    root = store.read("sequences")["root"][0].as_py()
    dataset = registry.find("datasets", "kitti").open_dataset(root)
    cue = CueInput(
        dataset.info(sequence), tuple(frames_of(store, "kitti", sequence)), dataset,
        store.tables("kitti", sequence, 2), objectness2d.Settings(), Serial(), 2,
    )  # fmt: skip
    return list(objectness2d.run(cue))


def test_every_proposal_with_points_in_the_image_gets_a_word(tmp_path: Path) -> None:
    store = world(tmp_path, images=True)
    with pytest.raises(EvidenceError, match="no trained segmenter"):
        measured(store)
    run_training(store, plan_recipe("segmenter", STEPS), selection_id=SELECTION)
    (rows,) = measured(store)
    assert rows.table == "confidences"
    assert rows.columns["proposal_id"] == ["van1", "far1", "van2", "far2"]
    assert set(rows.columns["module"]) == {"objectness_2d"}
    van, far, again, _ = rows.columns["confidence"]
    assert 0 < van < 1
    assert van == again
    assert far is None


def test_a_drive_without_images_needs_no_model_and_gets_no_word(tmp_path: Path) -> None:
    assert measured(world(tmp_path, images=False)) == []
