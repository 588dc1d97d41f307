"""Arrays of one number a point, on their way into and out of the table `point_evidence`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import MissingEvidenceError
from tcrdata.store.arrays import PointCodec, decode_points, encode_points
from tcrdata.types import Rows, Tables


@dataclass(frozen=True)
class EncodedPoints:
    """One row of `point_evidence`, small enough to hand to a worker process.

    Attributes:
        frame: number of the frame.
        cue: what was measured.
        codec: bits, u8, f16 or f32.
        data: the encoded array.
        count: number of points.
        summary: mean of the finite values; None when there are none.
    """

    frame: int
    cue: str
    codec: str
    data: bytes
    count: int
    summary: float | None

    def decode(self) -> NDArray[Any]:
        """Return the (count,) array: bool, uint8 or float32."""
        return decode_points(self.codec, self.data, self.count)


def encoded(frame: int, cue: str, codec: PointCodec, values: NDArray[Any]) -> EncodedPoints:
    """Return (N,) values of one frame and cue, encoded."""
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    summary = float(finite.mean(dtype=np.float64)) if len(finite) else None
    return EncodedPoints(frame, cue, codec, encode_points(values, codec), len(values), summary)


def point_rows(points: list[EncodedPoints]) -> Rows:
    """Return the rows of `point_evidence` for some encoded arrays."""
    return Rows(
        "point_evidence",
        {
            "frame": [p.frame for p in points],
            "cue": [p.cue for p in points],
            "number_of_points": [p.count for p in points],
            "codec": [p.codec for p in points],
            "data": [p.data for p in points],
            "summary": [p.summary for p in points],
        },
    )


def error_rows(errors: list[tuple[int, str]]) -> list[Rows]:
    """Return no or one batch of rows for frames that failed, given (frame, message)."""
    if not errors:
        return []
    return [Rows("errors", {"frame": [e[0] for e in errors], "error": [e[1] for e in errors]})]


def read_encoded(
    tables: Tables, frame: int, cue: str, *, round: int | None = None
) -> EncodedPoints | None:
    """Return what an earlier stage measured, still encoded; None when that frame has no row.

    Args:
        tables: of the sequence.
        frame: number of the frame.
        cue: what was measured.
        round: EM round that measured it; the tables' own when None.
    """
    table = tables.read(
        "point_evidence",
        columns=["codec", "data", "number_of_points", "summary"],
        cue=cue,
        frame=frame,
        **({} if round is None else {"round": round}),
    )
    rows = table.to_pylist()
    if not rows:
        return None
    row = rows[0]
    return EncodedPoints(
        frame, cue, row["codec"], row["data"], row["number_of_points"], row["summary"]
    )


def decode_matching(points: EncodedPoints, number_of_points: int) -> NDArray[Any]:
    """Return the (N,) array, checked against the number of points read just now.

    Raises:
        MissingEvidenceError: the points are not the ones that were measured.
    """
    if points.count != number_of_points:
        raise MissingEvidenceError(
            f"frame {points.frame}: cue '{points.cue}' was measured on {points.count} points but "
            f"the dataset now reads {number_of_points}: build into a new store"
        )
    return points.decode()
