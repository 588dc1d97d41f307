"""Detections that persist: one object a place, its box refitted, its numbers counted right."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from box_world import BoxWorld, Thing, collected

from tcrdata.evidence import detected_objects
from tcrdata.evidence.detection_groups import Detections, standing_groups
from tcrdata.evidence.standing_boxes import FitSettings, fitted
from tcrdata.geometry.boxes import bev_iou
from tcrdata.types import BOX_COLUMNS, CueInput

PARKED = Thing(3.5, 16.0, yaw=-1.5)
SEEN = (2, 3, 4, 6, 8, 9)
SPEED = 5.0


def world_cue(detections: list[tuple[int, np.ndarray, float]], **settings: Any) -> CueInput:
    """A drive past a parked car, with detections (frame, level box, score) of round 2."""
    world = BoxWorld((PARKED,), frames_count=24, own_speed=SPEED)
    cue = replace(world.cue(detected_objects.Settings(**settings)), round=2)
    rows: dict[str, list[dict[str, Any]]] = cue.tables._rows  # type: ignore[attr-defined]
    network = {"lateral_m": 20.0, "near_m": 0.0, "far_m": 40.0}
    rows["models"] = [{
        "model_id": "m", "kind": "detector", "network": "birds_eye", "labels_round": 1,
        "settings": json.dumps({"network": network}), "finished": True,
    }]  # fmt: skip
    rows["confidences"] = []
    for number, (frame, box, score) in enumerate(detections):
        key = {"proposal_id": f"d{number}", "frame": frame, "round": 2}
        rows["proposals"].append(
            {**key, "source": "detector", **dict(zip(BOX_COLUMNS, box, strict=True))}
        )
        rows["confidences"].append({**key, "module": "objectness_3d", "confidence": score})
    return cue


def roughly(frame: int) -> np.ndarray:
    """The parked car as a detector sees it: off by some 0.3 m, a little small and turned."""
    noise = np.random.default_rng(frame).normal(0, 0.2, 3)
    box = PARKED.box(frame, SPEED)
    return box + np.array([noise[0] + 0.2, 0, noise[1], -0.3, 0, 0, 0.1 * noise[2]])


def rows_of(detections: list[tuple[int, np.ndarray, float]], **settings: Any) -> list[dict]:
    cue = world_cue(detections, **settings)
    return collected(detected_objects.run(cue), "proposals")


@pytest.fixture(scope="module")
def parked() -> list[dict]:
    return rows_of([(frame, roughly(frame), 0.3 + 0.05 * frame) for frame in SEEN])


def test_detections_at_one_place_are_one_object_wherever_its_place_shows(parked) -> None:
    assert {row["track_id"] for row in parked} == {"boxes/one/detected.r2/0000"}
    assert [row["frame"] for row in parked] == list(range(24))
    assert [row["frame"] for row in parked if row["found"] == "observed"] == list(SEEN)
    assert [row["frame"] for row in parked if row["found"] == "gap"] == [5, 7]
    assert parked[0]["frames_from_observation"] == 2
    assert parked[23]["frames_from_observation"] == 14
    assert parked[0]["proposal_id"] == "boxes/one/000000/detected.r2/000/persistent"


def test_the_box_is_fitted_to_the_points_of_all_frames(parked) -> None:
    for row in parked:
        box = np.array([[row[name] for name in BOX_COLUMNS]])
        truth = PARKED.box(row["frame"], SPEED)[None]
        assert bev_iou(box, truth)[0, 0] > 0.8
        assert bev_iou(box, truth)[0, 0] > bev_iou(roughly(4)[None], PARKED.box(4, SPEED)[None])


def test_the_object_has_the_numbers_that_rules_read(parked) -> None:
    first = parked[0]
    scores = sorted((0.3 + 0.05 * frame for frame in SEEN), reverse=True)
    assert first["age_frames"] == len(SEEN)
    assert first["best_half_score"] == pytest.approx(np.mean(scores[:3]))
    assert first["visible_frames"] == 24
    assert first["visible_share"] == pytest.approx(len(SEEN) / 24)
    assert first["track_core_share"] == 0.0
    assert first["track_points"] > 50


def test_confidences_say_how_long_and_how_surely() -> None:
    cue = world_cue([(frame, roughly(frame), 0.6) for frame in SEEN])
    rows = collected(detected_objects.run(cue), "confidences")
    persistence = [row["confidence"] for row in rows if row["module"] == "persistence"]
    assert persistence == pytest.approx([0.6 * (1 - 2 ** (-6 / 4))] * 24)
    heat = {row["frame"]: row["confidence"] for row in rows if row["module"] == "objectness_3d"}
    assert [frame for frame, value in heat.items() if value is not None] == list(SEEN)


def test_faint_and_lonely_detections_are_no_objects() -> None:
    faint = [(frame, roughly(frame), 0.05) for frame in SEEN]
    assert rows_of(faint) == []
    assert rows_of([(3, roughly(3), 0.9)]) == []
    assert rows_of([]) == []


def test_groups_take_one_detection_a_frame_and_end_with_a_pause() -> None:
    frame = np.array([0, 0, 1, 2, 60, 61])
    boxes = np.zeros((6, 7))
    boxes[:, 3:6] = 1
    boxes[:, 0] = [0.0, 0.9, 0.1, 0.2, 0.0, 0.1]
    found = Detections(frame, boxes, np.full(6, 0.5), np.zeros(6, dtype=np.int64))
    groups = standing_groups(found, 1.3, 30, 1)
    assert [group.frames for group in groups] == [(0, 1, 2), (0,), (60, 61)]


@pytest.mark.parametrize(
    ("eyes", "middle", "size"),
    [([-9.0], 1.0, 4.0), ([9.0], 0.5, 4.0), ([-9.0, 9.0], 0.75, 3.5), ([0.5], 0.0, 4.0)],
)
def test_a_box_is_anchored_on_the_side_that_was_seen(eyes, middle, size) -> None:
    """Points reach from -1 to 2.5 along the length; 4 m were detected."""
    along = np.linspace(-1, 2.5, 400)
    points = np.column_stack([along, np.zeros(400), np.tile([-0.9, 0.9], 200), np.full(400, 1.0)])
    box = np.array([0, 0, 0, 4.0, 1.8, 1.5, 0.0])
    sensors = np.column_stack([eyes, np.zeros(len(eyes))])
    settings = FitSettings(trim_share=0.0, turn_rad=0.0, passes=1)
    found = fitted(box, points.astype(np.float32), sensors, settings)
    assert found[[0, 3]] == pytest.approx([middle, size], abs=1e-6)
    assert found[4] == pytest.approx(1.8)
