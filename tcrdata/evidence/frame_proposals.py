"""The proposals of a frame that a module is to judge, whatever their source, and its verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.evidence.point_rows import EncodedPoints, read_encoded
from tcrdata.evidence.proposal_columns import Columns
from tcrdata.types import BOX_COLUMNS, CueInput, FloatArray, Frame

EVIDENCE_ROUND = 1


@dataclass(frozen=True)
class FrameProposals:
    """The proposals of the first round and of the one that is measured, in one frame.

    Attributes:
        frame: theirs.
        ground: which points are ground, encoded; None where that was not measured.
        ids: of the proposals.
        sources: what found each.
        boxes: (N, 7): centre, length, width, height in metres, yaw.
        values: (N, K) of the columns that were asked for; NaN for NULL.
    """

    frame: Frame
    ground: EncodedPoints | None
    ids: tuple[str, ...]
    sources: tuple[str, ...]
    boxes: FloatArray
    values: FloatArray

    def confidences(
        self,
        module: str,
        confidence: Sequence[float | None],
        raw: Sequence[float | None],
        unit: str,
        numbers: Sequence[int] | None = None,
    ) -> Columns:
        """Return the columns of `confidences` for all proposals, or for those of these numbers."""
        chosen = range(len(self.ids)) if numbers is None else numbers
        count = len(chosen)
        return {
            "proposal_id": [self.ids[i] for i in chosen],
            "frame": [self.frame.frame] * count,
            "source": [self.sources[i] for i in chosen],
            "module": [module] * count,
            "confidence": list(confidence),
            "raw_value": list(raw),
            "unit": [unit] * count,
        }


def frame_proposals(cue: CueInput, frame: Frame, columns: tuple[str, ...] = ()) -> FrameProposals:
    """Return a frame's proposals, with some more of their columns."""
    rows: dict[str, dict[str, Any]] = {}
    for number in sorted({EVIDENCE_ROUND, cue.round}):
        table = cue.tables.read(
            "proposals",
            columns=["proposal_id", "source", *BOX_COLUMNS, *columns],
            round=number,
            frame=frame.frame,
        )
        rows |= {row["proposal_id"]: row for row in table.to_pylist()}
    listed = rows.values()
    boxes, values = (
        np.array([[row[name] for name in names] for row in listed], np.float64)
        for names in (BOX_COLUMNS, columns)
    )
    return FrameProposals(
        frame,
        read_encoded(cue.tables, frame.frame, "ground", round=EVIDENCE_ROUND),
        tuple(rows),
        tuple(row["source"] for row in listed),
        boxes.reshape(-1, len(BOX_COLUMNS)),
        values.reshape(len(rows), len(columns)),
    )
