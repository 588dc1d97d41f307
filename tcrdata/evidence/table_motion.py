"""Whether what stands on a table moved: what free space says of its points, frame by frame.

Every thing that `table_clusters` followed gets a confidence of module `free_space` in each frame,
of the votes on its points, and one of module `moved` for all of its frames: of its points, the
share that other frames saw through, in the frames that show most.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.evidence.point_rows import read_encoded
from tcrdata.evidence.proposal_columns import Columns
from tcrdata.types import CueInput, ImageArray, Rows

NEEDS: tuple[str, ...] = ("table_clusters", "free_space")
GIVES: tuple[str, ...] = ("confidences",)
NEEDS_IMAGES: bool = False

MODULE, FRAME_MODULE = "moved", "free_space"
TABLE = "table"
CORE_VOTES = 2
"""Points with so many free votes, and more than static ones, are a region's core points."""


@dataclass(frozen=True)
class Settings:
    """How frames are taken together.

    Attributes:
        frames_share: a thing moved as far as it did in this share of its frames, at the least: what
            stands for most of a clip moved, too.
    """

    frames_share: float = 0.2


@dataclass(frozen=True)
class _Seen:
    """One proposal: mean votes on its points, and the share that are core points."""

    proposal_id: str
    frame: int
    track: str
    free: float
    static: float
    core_share: float


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `confidences` of the modules free_space and moved for proposals of source table."""
    seen = [entry for frame in cue.frames for entry in _seen_in(cue, frame.frame)]
    shares: dict[str, list[float]] = defaultdict(list)
    for entry in seen:
        shares[entry.track].append(entry.core_share)
    level = 1 - cue.settings.frames_share
    moved = {track: float(np.quantile(own, level)) for track, own in shares.items()}
    if seen:
        both = [e.free + e.static for e in seen]
        sure = [e.free / total if total else None for e, total in zip(seen, both, strict=True)]
        yield Rows(
            "confidences",
            _columns(seen, FRAME_MODULE, sure, [e.free for e in seen], "votes a point"),
        )
        yield Rows(
            "confidences",
            _columns(
                seen, MODULE, [moved[e.track] for e in seen], [e.core_share for e in seen],
                "share of the points seen through in this frame",
            ),
        )  # fmt: skip


def _seen_in(cue: CueInput, frame: int) -> Iterator[_Seen]:
    votes = [read_encoded(cue.tables, frame, name) for name in ("votes_free", "votes_static")]
    if None in votes:
        return
    free, static = (row.decode() for row in votes if row is not None)
    columns = ["proposal_id", "track_id", "point_indices"]
    for row in cue.tables.read("proposals", columns=columns, source=TABLE, frame=frame).to_pylist():
        points = np.array(row["point_indices"], dtype=np.int64)
        if len(points):
            yield _seen(row, frame, free[points], static[points])


def _seen(row: dict[str, Any], frame: int, free: ImageArray, static: ImageArray) -> _Seen:
    core = (free >= CORE_VOTES) & (free > static)
    return _Seen(
        row["proposal_id"], frame, row["track_id"], float(free.mean()), float(static.mean()),
        float(core.mean()),
    )  # fmt: skip


def _columns(
    seen: list[_Seen], module: str, confidence: list[Any], raw: list[float], unit: str
) -> Columns:
    count = len(seen)
    return {
        "proposal_id": [entry.proposal_id for entry in seen],
        "frame": [entry.frame for entry in seen],
        "source": [TABLE] * count,
        "module": [module] * count,
        "confidence": confidence,
        "raw_value": raw,
        "unit": [unit] * count,
    }
