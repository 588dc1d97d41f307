"""Small worlds with known scores, as rows of the store's tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcrdata.store import Store, Unit, open_store

PROJECTION = [700.0, 0, 600, 0, 0, 700.0, 180, 0, 0, 0, 1, 0]
IDENTITY = np.eye(4).ravel().tolist()


def sequence_row(sequence: str, sensor: str = "lidar", scale: float = 1.0) -> dict[str, Any]:
    return {
        "sequence": sequence,
        "root": "/",
        "sensor": sensor,
        "metric_scale": scale,
        "static_camera": False,
        "calibration": "generated",
        "fingerprint": "0",
        "number_of_frames": 3,
    }


def frame_row(sequence: str, frame: int, status: str = "ok") -> dict[str, Any]:
    return {
        "sequence": sequence,
        "frame": frame,
        "timestamp_ns": frame * 10**8,
        "width_px": 1200,
        "height_px": 360,
        "projection": PROJECTION,
        "camera_T_level": IDENTITY,
        "level_T_sensor": IDENTITY,
        "has_image": True,
        "status": status,
    }


def box(x: float, z: float, yaw: float = 0.0, size: float = 1.0) -> dict[str, Any]:
    """A car-like box and, roughly, its place in the image."""
    u, v, half = 600 + 700 * x / z, 180 + 700 / z, 700 * size / z
    return {
        "x_m": x,
        "y_m": 1.0,
        "z_m": z,
        "length_m": 4.0 * size,
        "width_m": 2.0 * size,
        "height_m": 1.5 * size,
        "yaw_rad": yaw,
        "left_px": u - half,
        "top_px": v - half,
        "right_px": u + half,
        "bottom_px": v + half,
    }


def truth_row(sequence: str, frame: int, object_id: str, **values: Any) -> dict[str, Any]:
    return {
        "sequence": sequence,
        "frame": frame,
        "object_id": object_id,
        "category": "Car",
        "speed_mps": 0.0,
        "yaw_observable": True,
        **values,
    }


def label_row(sequence: str, frame: int, name: str, score: float, **values: Any) -> dict[str, Any]:
    return {
        "selection_id": "s1",
        "proposal_id": name,
        "sequence": sequence,
        "frame": frame,
        "state": "positive",
        "score": score,
        "source": "track",
        **values,
    }


def make_store(name: str, dataset: str = "kitti", **tables: list[dict[str, Any]]) -> Store:
    """A store in memory; labels belong to selection s1, all other rows to their sequence."""
    judged = ("proposals", "confidences", "egomotions", "frames", "sequences")
    store = open_store(f"memory://{name}", create=True)
    labels = tables.pop("labels", [])
    for sequence in [row["sequence"] for row in tables["sequences"]]:
        with store.writer(Unit("ingest", dataset, sequence, 1), settings_hash="0", inputs={}) as w:
            for table, rows in tables.items():
                own = [row for row in rows if row["sequence"] == sequence]
                w.append(table, columns_of(own))
    frozen = store.freeze(None, judged)
    selection = {
        "selection_id": "s1",
        "name": "test",
        "preset": "test",
        "snapshot": frozen.name,
        "rules": [],
        "rule_texts": [],
        "required": [],
        "preset_text": "",
        "parameters": {},
        "proposals_judged": 9,
        "labels": len(labels),
    }
    with store.writer(Unit("selection", "_", "s1", 1), settings_hash="0", inputs={}) as w:
        w.append("selections", columns_of([selection]))
        w.append("labels", columns_of([{"dataset": dataset, **row} for row in labels]))
    return store


def columns_of(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}
