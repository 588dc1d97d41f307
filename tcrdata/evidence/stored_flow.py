"""Pairs of frames with images, and their flow as the cue `flow` left it in the table `flows`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from tcrdata.evidence.flow_cycle import PAPER_BIT, RELEASE_BIT
from tcrdata.store.arrays import decode_bits, decode_flow
from tcrdata.types import BoolArray, Float32Array, Frame, Tables

CycleTest = Literal["paper", "release", "none"]
_BITS: dict[CycleTest, int] = {"paper": PAPER_BIT, "release": RELEASE_BIT}
_COLUMNS = ["frame_to", "method", "height_px", "width_px", "codec", "data", "consistent"]


class Pair(NamedTuple):
    """A frame and the next one that can be used."""

    first: Frame
    second: Frame


@dataclass(frozen=True)
class StoredFlow:
    """One row of `flows`, still encoded, so that it is light to hand to a worker.

    Attributes:
        frame: where the flow starts.
        frame_to: where it ends.
        method: what estimated it.
        height_px: image height.
        width_px: image width.
        codec: of `data`.
        data: the encoded flow.
        consistent: the encoded bit planes of the cycle tests.
    """

    frame: int
    frame_to: int
    method: str
    height_px: int
    width_px: int
    codec: str
    data: bytes
    consistent: bytes

    def decode(self) -> Float32Array:
        """Return the (H, W, 2) flow in pixels."""
        return decode_flow(self.codec, self.data, self.height_px, self.width_px)

    def passes(self, test: CycleTest) -> BoolArray:
        """Return (H, W): which pixels pass a cycle test; all of them for `none`."""
        if test == "none":
            return np.ones((self.height_px, self.width_px), dtype=bool)
        return decode_bits(self.consistent, self.height_px, self.width_px) & _BITS[test] > 0


def image_pairs(frames: Sequence[Frame]) -> list[Pair]:
    """Return each frame with the next, where both have an image."""
    return [
        Pair(first, second)
        for first, second in pairwise(frames)
        if first.has_image and second.has_image
    ]


def read_flow(tables: Tables, start: Frame, end: Frame) -> StoredFlow | None:
    """Return the flow from one frame to another; None when it was not measured."""
    direction = "forward" if end.frame > start.frame else "backward"
    table = tables.read("flows", columns=_COLUMNS, frame=start.frame, direction=direction)
    for row in table.to_pylist():
        if row["frame_to"] == end.frame:
            return StoredFlow(frame=start.frame, **row)
    return None
