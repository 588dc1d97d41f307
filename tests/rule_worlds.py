"""Small worlds of proposals to judge."""

from __future__ import annotations

from typing import Any

import duckdb

from tcrdata.inspection.rule_cases import KEYS, PROPOSAL
from tcrdata.store import Store, Unit

GOOD_TRACK: dict[str, Any] = {
    "age_frames": 10,
    "travel_m": 5.0,
    "straightness": 0.9,
    "at_clip_edge": False,
    "track_core_share": 0.8,
    "frames_from_observation": 0,
    "overlapped_share": 0.0,
}


def proposal_rows(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fill in what a row must have; ids are numbered unless given."""
    filled = [{**PROPOSAL, **row} for row in rows]
    for number, row in enumerate(filled):
        row.setdefault("proposal_id", f"p{number:03d}")
    return filled


def insert(connection: duckdb.DuckDBPyConnection, table: str, rows: list[dict[str, Any]]) -> None:
    for row in rows:
        names = ", ".join(row)
        marks = ", ".join("?" for _ in row)
        connection.execute(f"insert into {table} ({names}) values ({marks})", list(row.values()))


def put(
    store: Store, stage: str, sequence: str, tables: dict[str, list[dict[str, Any]]], **record: Any
) -> None:
    """Commit rows as one unit."""
    unit = Unit(stage, "d", sequence, 1)
    with store.writer(unit, settings_hash=record.get("settings_hash", "x"), inputs={}) as writer:
        for table, rows in tables.items():
            names = {name for row in rows for name in row} - set(KEYS)
            writer.append(table, {n: [row.get(n) for row in rows] for n in sorted(names)})


def put_tracks(store: Store, sequence: str, rows: list[dict[str, Any]]) -> None:
    """Commit a sequence of tracks with sound odometry, and a confidence each."""
    named = [
        {"proposal_id": f"d/{sequence}/{number:06d}", **row} for number, row in enumerate(rows)
    ]
    proposals = proposal_rows(named)
    confidences = [
        {"proposal_id": row["proposal_id"], "frame": row["frame"], "module": "track",
         "confidence": 0.75, "raw_value": 0.75, "unit": "share"}
        for row in proposals
    ]  # fmt: skip
    put(store, "tracks", sequence, {"proposals": proposals, "confidences": confidences})
    put(store, "odometry", sequence, {
        "egomotions": [
            {"frame": 0, "frame_to": 1, "method": "odometry", "cycle_error_m": 0.05,
             "alignment_share": 0.9, "alignment_frames": 10}
        ]
    })  # fmt: skip
