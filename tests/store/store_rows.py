"""Rows to put into a store, and what a store on disk holds."""

from __future__ import annotations

from pathlib import Path

from tcrdata.store import Unit

UNIT = Unit("ground", "kitti", "0001", 1)


def evidence(frames, cue="ground", size=8):
    """Rows of `point_evidence`, a heavy table."""
    return {
        "frame": list(frames),
        "cue": [cue] * len(frames),
        "number_of_points": [size] * len(frames),
        "codec": ["u8"] * len(frames),
        "data": [bytes([frame % 256]) * size for frame in frames],
        "summary": [frame / 2 for frame in frames],
    }


def confidences(count, confidence=0.5):
    """Rows of `confidences`, a light table."""
    return {
        "proposal_id": [f"p{number}" for number in range(count)],
        "frame": list(range(count)),
        "module": ["free_space"] * count,
        "confidence": [confidence] * count,
        "raw_value": [1.0] * count,
        "unit": ["votes"] * count,
    }


def commit(store, unit=UNIT, *, settings="s", inputs=None, **tables):
    """Write a unit of the given tables."""
    with store.writer(unit, settings_hash=settings, inputs=inputs or {}) as writer:
        for table, columns in tables.items():
            writer.append(table, columns)


def contents(store) -> dict[str, bytes]:
    """Every file of a store on disk."""
    root = Path(store.url)
    return {
        str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()
    }
