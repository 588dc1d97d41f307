"""A small drive on the disk, in a store with evidence and labels written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import kitti_tree
import numpy as np
from label_worlds import columns_of, label_row

from tcrdata import registry
from tcrdata.evidence.point_rows import encoded, point_rows
from tcrdata.executors import Serial
from tcrdata.ingest import frames_of, ingest_frames, ingest_truth
from tcrdata.pipeline import plan_build
from tcrdata.store import Store, Unit, open_store
from tcrdata.types import Dataset, PointCloud

TINY = {
    "network.lateral_m": "16",
    "network.far_m": "32",
    "network.cell_m": "0.5",
    "network.widths": "8,8,8",
    "network.head_width": "8",
    "steps": "6",
    "batch": "2",
    "checkpoint_steps": "2",
    "workers": "0",
}
"""Settings of a detector that trains in a second."""

SELECTION = "s1"
VAN, CAR = 0, 1


def learnt_world(
    folder: Path, *, frames: int = 5, images: bool = True, positive: bool = True
) -> Store:
    """The van of each frame is a positive label (if any is), the parked car is left undecided."""
    root = folder / "kitti"
    kitti_tree.write_raw(root, frames=frames, images=images)
    plan = plan_build("kitti", str(root), presets=("tcrdata",))
    dataset: Dataset = registry.find("datasets", "kitti").open_dataset(str(root))
    store = open_store(str(folder / "store"), create=True)
    (sequence,) = plan.sequences
    ingest_frames(store, plan, dataset, dataset.info(sequence), Serial())
    ingest_truth(store, plan, dataset, sequence)
    listed = list(frames_of(store, "kitti", sequence))
    with store.writer(Unit("votes", "kitti", sequence, 1), settings_hash="0", inputs={}) as writer:
        for frame in listed:
            rows = evidence(frame.frame, dataset.read_points(frame))
            writer.append(rows.table, rows.columns)
    labels = [
        label(sequence, frame.frame, index, positive and index == VAN)
        for frame in listed
        for index in (VAN, CAR)
    ]
    select_by_hand(store, SELECTION, labels)
    return store


def evidence(number: int, cloud: PointCloud) -> Any:
    """Ground below 0.1 m; all that stands was seen standing by ten sweeps, the van by none."""
    height = np.float32(kitti_tree.SENSOR_HEIGHT_M) - cloud.xyz[:, 1] - np.float32(0.08)
    centre, size, _ = kitti_tree.box_in_level(VAN, number)
    on_van = (np.abs(cloud.xyz - centre)[:, [0, 2]] < size[[1, 0]] / 2 + 0.2).all(axis=1)
    static = np.where(on_van, 0, 10).astype(np.uint8)
    return point_rows(
        [
            encoded(number, "ground", "bits", height < 0.1),
            encoded(number, "height_m", "f16", height),
            encoded(number, "votes_static", "u8", static),
            encoded(number, "votes_free", "u8", np.where(on_van, 5, 0).astype(np.uint8)),
        ]
    )


def label(sequence: str, frame: int, index: int, positive: bool) -> dict[str, Any]:
    (x, y, z), (length, width, height), yaw = kitti_tree.box_in_level(index, frame)
    values: dict[str, Any] = {"x_m": x, "y_m": y, "z_m": z, "yaw_rad": yaw}
    values |= {"length_m": length, "width_m": width, "height_m": height}
    u, v, half = 79.5 + 93.0 * x / z, 22.0 + 93.0 * y / z, 93.0 / z
    sides = {"left_px": u - half, "right_px": u + half, "top_px": v - half, "bottom_px": v + half}
    return label_row(
        sequence, frame, f"kitti/{sequence}/{frame:06d}/{index}", 0.9, **values, **sides,
        dataset="kitti", state="positive" if positive else "ignore", truncated_share=0.0,
        speed_mps=kitti_tree.OBJECTS[index][4],
    )  # fmt: skip


def select_by_hand(
    store: Store, selection_id: str, labels: list[dict[str, Any]], preset: str = "by-hand"
) -> None:
    """Write labels as a selection, and point to it."""
    selection = {
        "selection_id": selection_id, "name": selection_id, "preset": preset, "snapshot": "none",
        "rules": [], "rule_texts": [], "required": [], "preset_text": "", "parameters": {},
        "proposals_judged": 9, "labels": len(labels),
    }  # fmt: skip
    rows = [{**row, "selection_id": selection_id} for row in labels]
    unit = Unit("selection", "_", selection_id, 1)
    with store.writer(unit, settings_hash="0", inputs={}) as writer:
        writer.append("selections", columns_of([selection]))
        writer.append("labels", columns_of(rows))
    store.point_to(selection_id, selection_id)
