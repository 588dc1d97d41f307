"""Recordings, read back: entities, times, and the numbers of one frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rerun")

from rerun.chunk import RrdReader

from tcrdata.views.rerun_recording import (
    TRAIL_FRAMES,
    RecordedBoxes,
    RecordedFrame,
    RerunRecording,
)

PROJECTION = np.array([[700.0, 0, 60, 35.0], [0, 700.0, 18, 0], [0, 0, 1, 0]])


def pose(x: float) -> np.ndarray:
    result = np.eye(4)
    result[0, 3] = x
    return result


def labelled(*names: str, x: float = 2.0) -> RecordedBoxes:
    boxes = np.array([[x, 1.0, 15.0, 4.0, 1.8, 1.5, np.pi / 2]] * len(names)).reshape(-1, 7)
    return RecordedBoxes(boxes, names, np.full(len(names), 0.75), np.full(len(names), 40.0))


def shot(frame: int, boxes: dict[str, RecordedBoxes], segment: int = 0, **more: Any) -> Any:
    return RecordedFrame(
        frame=frame,
        timestamp_ns=10**18 + frame * 10**8,
        world_T_level=pose(frame),
        segment=segment,
        path=np.array([[0.0, 0, 0], [9.0, 0, 0]]),
        points=np.full((5, 3), 2.0, dtype=np.float32),
        classes=np.array([0, 1, 2, 2, 0]),
        boxes=boxes,
        **more,
    )


def recorded(path: Path, shots: list[RecordedFrame]) -> dict[str, list[dict[str, Any]]]:
    """Entity to its rows, static ones left out, in order of the frames."""
    with RerunRecording(path, "a drive") as recording:
        for one in shots:
            recording.add(one)
    rows: dict[str, list[dict[str, Any]]] = {}
    for chunk in RrdReader(path).stream():
        if not chunk.is_static:
            found = chunk.to_record_batch().to_pylist()
            rows.setdefault(chunk.entity_path, []).extend(found)
    return {entity: sorted(found, key=lambda row: row["frame"]) for entity, found in rows.items()}


def test_each_frame_has_its_points_boxes_and_pose(tmp_path: Path) -> None:
    image = np.full((36, 120, 3), 90, dtype=np.uint8)
    shots = [
        shot(n, {"labels": labelled("track/7")}, image=image, projection=PROJECTION)
        for n in (4, 5, 6)
    ]
    rows = recorded(tmp_path / "s.rrd", shots)
    points = rows["/world/level/points"]
    assert [row["frame"] for row in points] == [4, 5, 6]
    assert [len(row["Points3D:positions"]) for row in points] == [5, 5, 5]
    assert points[0]["Points3D:class_ids"] == [0, 1, 2, 2, 0]
    assert points[1]["timestamp"].value == 10**18 + 5 * 10**8
    assert "log_time" not in points[0]
    level = rows["/world/level"]
    assert [row["Transform3D:translation"][0] for row in level] == [[4, 0, 0], [5, 0, 0], [6, 0, 0]]
    (first, *_) = rows["/world/level/boxes/labels"]
    np.testing.assert_allclose(first["Boxes3D:half_sizes"], [[2.0, 0.75, 0.9]])
    half = np.sqrt(0.5)
    np.testing.assert_allclose(first["Boxes3D:quaternions"], [[0, half, 0, half]], rtol=1e-6)
    assert first["Boxes3D:labels"] == ["track/7 0.75"]
    assert rows["/world/level/boxes/truth"][0]["Boxes3D:centers"] == []
    assert len(rows["/world/level/camera/image"]) == 3
    assert rows["/plots/score/track/7"][0]["Scalars:scalars"] == [0.75]
    assert rows["/plots/count/labels"][2]["Scalars:scalars"] == [1.0]


def test_the_camera_stands_where_its_projection_says(tmp_path: Path) -> None:
    rows = recorded(tmp_path / "s.rrd", [shot(0, {}, projection=PROJECTION)])
    found: dict[str, Any] = {}
    for row in rows["/world/level/camera"]:
        found |= {name: value for name, value in row.items() if value is not None}
    np.testing.assert_allclose(found["Transform3D:translation"], [[-0.05, 0, 0]], atol=1e-7)
    matrix = np.reshape(found["Pinhole:image_from_camera"], (3, 3)).T
    np.testing.assert_allclose(matrix, PROJECTION[:, :3])


def test_a_trail_is_short_grows_old_and_ends_with_the_segment(tmp_path: Path) -> None:
    long = [shot(n, {"labels": labelled("a", "")}) for n in range(TRAIL_FRAMES + 5)]
    gone = [shot(TRAIL_FRAMES + 5, {})]
    other = [shot(TRAIL_FRAMES + 6, {"labels": labelled("a")}, segment=1)]
    rows = recorded(tmp_path / "s.rrd", [*long, *gone, *other])
    trails = [row["LineStrips3D:strips"] for row in rows["/world/trails"]]
    assert [len(trails[n][0]) for n in (0, 1, TRAIL_FRAMES + 4)] == [1, 2, TRAIL_FRAMES]
    assert all(len(strips) == 1 for strips in trails)
    assert trails[1][0][1] == [3.0, 1.0, 15.0]
    assert len(trails[-2][0]) == TRAIL_FRAMES - 1
    assert len(trails[-1][0]) == 1
    assert [row["frame"] for row in rows["/world/ego"]] == [0, TRAIL_FRAMES + 6]


def test_the_blueprint_comes_along(tmp_path: Path) -> None:
    recorded(tmp_path / "s.rrd", [shot(0, {})])
    reader = RrdReader(tmp_path / "s.rrd")
    assert [entry.recording_id for entry in reader.recordings()] == ["a drive"]
    (blueprint,) = reader.blueprints()
    views = [chunk.entity_path for chunk in reader.stream(store=blueprint)]
    assert sum(path.startswith("/view/") and path.count("/") == 2 for path in views) == 5
