"""Tracklets as proposals, so that rules can let their boxes be labels: the next round's, or now.

Rows of `truth_tracklets` are never read here: what began with a true box can be no label.
"""

from __future__ import annotations

from typing import Any

from tcrdata.store import Store, Unit
from tcrdata.store.followed import BOXES
from tcrdata.types import BOX_COLUMNS

SOURCE = "tracklet"
_COPIED = (
    "frame", *BOX_COLUMNS, "left_px", "top_px", "right_px", "bottom_px", "center_u_px",
    "center_v_px", "truncated_share", "number_of_points", "speed_mps",
)  # fmt: skip
_SEEN = ("nearest", "correlation")


def write_boxes(store: Store, unit: Unit, tracked: Unit, *, library: bool) -> bool:
    """Commit one sequence's tracklets as proposals with their confidences.

    Args:
        store: holds the tracklets.
        unit: that they become.
        tracked: the unit that made them.
        library: which of the two kinds of tracklets they are.

    Returns:
        Whether anything was written; False when these very tracklets' boxes are there.
    """
    record = store.record(tracked)
    inputs = {tracked.stage: record.digest if record else "missing"}
    if store.is_done(unit, BOXES, inputs):
        return False
    rows = store.read(
        "tracklets", dataset=unit.dataset, sequence=unit.sequence, library=library,
        selection_id=unit.stage.partition("-")[2],
    ).to_pylist()  # fmt: skip
    scale = store.read("sequences", columns=["metric_scale"], dataset=unit.dataset,
                       sequence=unit.sequence)["metric_scale"][0].as_py()  # fmt: skip
    sensors = _sensors(store, unit)
    with store.writer(unit, settings_hash=BOXES, inputs=inputs) as writer:
        writer.append("proposals", _proposals(rows, unit, scale, sensors))
        writer.append("confidences", _confidences(rows, unit))
    return True


def _sensors(store: Store, unit: Unit) -> dict[int, tuple[float, float]]:
    """Return each frame's place of the sensor, x and z in the level frame."""
    rows = store.read(
        "frames", columns=["frame", "level_T_sensor"], dataset=unit.dataset, sequence=unit.sequence
    ).to_pylist()
    return {row["frame"]: (row["level_T_sensor"][3], row["level_T_sensor"][11]) for row in rows}


def _proposals(
    rows: list[dict[str, Any]], unit: Unit, scale: float, sensors: dict[int, tuple[float, float]]
) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in _COPIED}
    names = [_name(row, unit) for row in rows]
    columns |= {
        "proposal_id": [f"{name}/{SOURCE}" for name in names],
        "region_id": names,
        "source": [SOURCE] * len(rows),
        "fit": [SOURCE] * len(rows),
        "track_id": [row["tracklet_id"] for row in rows],
        "found": ["observed" if row["found"] in _SEEN else "gap" for row in rows],
        "metric_scale": [scale] * len(rows),
        "range_m": [
            ((r["x_m"] - sensors[r["frame"]][0]) ** 2 + (r["z_m"] - sensors[r["frame"]][1]) ** 2)
            ** 0.5
            for r in rows
        ],
        "occluded_share": [1 - row["visible_share"] for row in rows],
        "frames_from_observation": [row["frames_from_sighting"] for row in rows],
    }
    return columns


def _confidences(rows: list[dict[str, Any]], unit: Unit) -> dict[str, list[Any]]:
    values = [row["passable"] if row["score"] is None else row["score"] for row in rows]
    return {
        "proposal_id": [f"{_name(row, unit)}/{SOURCE}" for row in rows],
        "frame": [row["frame"] for row in rows],
        "source": [SOURCE] * len(rows),
        "module": [SOURCE] * len(rows),
        "confidence": values,
        "raw_value": values,
        "unit": ["score, or mean p out of sight"] * len(rows),
    }


def _name(row: dict[str, Any], unit: Unit) -> str:
    _, _, name, number = row["tracklet_id"].rsplit("/", 3)
    return f"{unit.dataset}/{unit.sequence}/{row['frame']:06d}/{name}/{number}"
