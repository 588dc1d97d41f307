"""What a teacher says of whole pairs of images, kept for the next piece that is cut of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tcrdata.evidence.flow_cycle import measure
from tcrdata.evidence.flow_estimators import Estimator
from tcrdata.networks.flow_losses import FlowLossSettings
from tcrdata.types import BoolArray, Float32Array, ImageArray


class TaughtFlow(NamedTuple):
    """One pair as a teacher has it.

    Attributes:
        flows: forward and backward, each (H, W, 2) px.
        trusted: (H, W) each: where that flow's cycle is consistent.
    """

    flows: tuple[Float32Array, Float32Array]
    trusted: tuple[BoolArray, BoolArray]

    @property
    def size_bytes(self) -> int:
        """Memory of the arrays."""
        return sum(array.nbytes for array in (*self.flows, *self.trusted))

    def mirrored(self) -> TaughtFlow:
        """Return the flow of the pair with left and right changed: views where it can be."""
        turned = np.array([-1, 1], np.float32)
        forward, backward = (flow[:, ::-1] * turned for flow in self.flows)
        here, there = (kept[:, ::-1] for kept in self.trusted)
        return TaughtFlow((forward, backward), (here, there))


class TaughtFlows:
    """Asks the teacher once for each pair that there is room for.

    What it says of a pair is the same whether it was kept or not. Picklable.
    """

    def __init__(self, teacher: Estimator, losses: FlowLossSettings, most_bytes: int) -> None:
        """Ask nothing yet.

        Args:
            teacher: sees clean, whole images.
            losses: which of its pixels are trusted.
            most_bytes: that are kept, of the pairs asked for first: in an order that is shuffled
                anew each time those asked for last would hardly come again before they go.
        """
        self._teacher, self._losses, self._most_bytes = teacher, losses, most_bytes
        self._kept: dict[str, TaughtFlow] = {}
        self._bytes = 0

    def of_pair(self, key: str, first: ImageArray, second: ImageArray) -> TaughtFlow:
        """Return the flow of a pair.

        Args:
            key: names the pair.
            first: (H, W, 3) RGB.
            second: of the same size.
        """
        if key in self._kept:
            return self._kept[key]
        found = self._looked(first, second)
        if self._bytes + found.size_bytes <= self._most_bytes:
            self._kept[key] = found
            self._bytes += found.size_bytes
        return found

    def _looked(self, first: ImageArray, second: ImageArray) -> TaughtFlow:
        flows = self._teacher.both_ways(first, second)
        share, slack = self._losses.cycle_share, self._losses.cycle_slack_px
        forward, backward = (
            measure(flow, back, share, slack).paper for flow, back in (flows, flows[::-1])
        )
        return TaughtFlow(flows, (forward, backward))
