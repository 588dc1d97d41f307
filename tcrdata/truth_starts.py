"""True first boxes: what tracking begins with when it is evaluated, and nothing else reads."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.geometry.boxes import points_in_box
from tcrdata.reports import run_report
from tcrdata.store import Store
from tcrdata.tracked_scenes import SceneSource
from tcrdata.types import BOX_COLUMNS, FloatArray


def starts_left_out(store: Store, selection_id: str) -> str | None:
    """Return in one line how many labelled objects no tracklet began with; None when none is.

    Args:
        store: holds the truth, and what was tracked from it.
        selection_id: whose labels were candidates.
    """
    connection = store.connect(tables=("ground_truth", "truth_tracklets"))
    try:
        found = run_report(connection, "tracking_starts", {"selection_id": selection_id})
        rows = found.fetchall()
    finally:
        connection.close()
    begun, objects = rows[0] if rows else (0, 0)
    if begun == objects:
        return None
    return (
        f"{objects - begun} of {objects} labelled objects are not tracked from truth: no frame "
        "shows enough of their points inside the view and the region of `evaluate`"
    )


def first_boxes(
    store: Store, source: SceneSource, dataset: str, sequence: str, least_points: int
) -> dict[int, list[tuple[str, FloatArray]]]:
    """Return frame to (object id, (7,) box in the world) of each object's first usable frame.

    Args:
        store: holds the truth.
        source: of the sequence's frames.
        dataset: its name.
        sequence: the drive or clip.
        least_points: a frame that shows fewer points in the box is not begun with; an object that
            never shows as many, or is never in view, is left out.
    """
    tables = ("ground_truth", "labels", "tracklets", "truth_tracklets", "frames", "sequences")
    connection = store.connect(tables=tables)
    try:
        parameters = {
            "scored_dataset": dataset, "scored_sequence": sequence, "scored_kinds": ["truth"]
        }  # fmt: skip
        rows = run_report(connection, "tracking_objects", parameters).to_arrow_table().to_pylist()
    finally:
        connection.close()
    by_frame: dict[int, list[dict[str, object]]] = defaultdict(list)
    for row in rows:
        if row["scored"]:
            by_frame[row["frame"]].append(row)
    begun: set[str] = set()
    result: dict[int, list[tuple[str, FloatArray]]] = defaultdict(list)
    for frame in sorted(by_frame):
        fresh = [row for row in by_frame[frame] if row["series_id"] not in begun]
        if not fresh or frame not in source.world.frames:
            continue
        try:
            cloud = source.dataset.read_points(source.world.frames[frame])
        except FrameError:
            continue
        for row in fresh:
            box = np.array([row[name] for name in BOX_COLUMNS], dtype=np.float64)
            if points_in_box(cloud.xyz, box).sum() >= least_points:
                begun.add(str(row["series_id"]))
                placed = source.world.box_to_world(frame, box)
                result[frame].append((str(row["series_id"]), placed))
    return dict(result)
