"""What a teacher says of whole pairs of images, kept for the next piece that is cut of them."""

from __future__ import annotations

from collections import OrderedDict
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

    def mirrored(self) -> TaughtFlow:
        """Return the flow of the pair with left and right changed: views where it can be."""
        turned = np.array([-1, 1], np.float32)
        forward, backward = (flow[:, ::-1] * turned for flow in self.flows)
        here, there = (kept[:, ::-1] for kept in self.trusted)
        return TaughtFlow((forward, backward), (here, there))


class TaughtFlows:
    """Asks the teacher once for a pair, as long as no more pairs than are kept come between.

    What it says of a pair is the same whether it was kept or not. Picklable.
    """

    def __init__(self, teacher: Estimator, losses: FlowLossSettings, most: int) -> None:
        """Ask nothing yet.

        Args:
            teacher: sees clean, whole images.
            losses: which of its pixels are trusted.
            most: pairs that are kept, those asked for last; 0 keeps none.
        """
        self._teacher, self._losses, self._most = teacher, losses, most
        self._kept: OrderedDict[str, TaughtFlow] = OrderedDict()

    def of_pair(self, key: str, first: ImageArray, second: ImageArray) -> TaughtFlow:
        """Return the flow of a pair.

        Args:
            key: names the pair.
            first: (H, W, 3) RGB.
            second: of the same size.
        """
        found = self._kept.pop(key, None) or self._looked(first, second)
        self._kept[key] = found
        if len(self._kept) > self._most:
            self._kept.popitem(last=False)
        return found

    def _looked(self, first: ImageArray, second: ImageArray) -> TaughtFlow:
        flows = self._teacher.both_ways(first, second)
        share, slack = self._losses.cycle_share, self._losses.cycle_slack_px
        forward, backward = (
            measure(flow, back, share, slack).paper for flow, back in (flows, flows[::-1])
        )
        return TaughtFlow(flows, (forward, backward))
