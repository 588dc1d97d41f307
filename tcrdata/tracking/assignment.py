"""Which candidate box belongs to which target: the cheapest assignment within gates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.tracking.scenes import Candidates
from tcrdata.tracking.targets import Target
from tcrdata.types import FloatArray

_FAR = 1e3


@dataclass(frozen=True)
class Gates:
    """How far candidates may be from predictions; metres are multiplied by the metric scale.

    Attributes:
        gate_m: largest distance of a candidate from the prediction.
        new_gate_m: the same for a target that was seen once, whose speed is unknown.
        gap_gate_m: the gate grows by this for each missing frame.
        name_gates: so many gates wide is the gate for a candidate that its finder linked to it.
        size_cost: cost, in gates, of a size that differs by a factor e.
    """

    gate_m: float = 1.3
    new_gate_m: float = 2.6
    gap_gate_m: float = 0.3
    name_gates: float = 2.0
    size_cost: float = 0.3


def assigned(
    targets: Sequence[Target],
    expected: Sequence[FloatArray],
    candidates: Candidates,
    frame: int,
    gates: Gates,
) -> list[int]:
    """Return the number of each target's candidate, -1 without one.

    Args:
        targets: in sight.
        expected: (7,) box of each.
        candidates: of the frame.
        frame: its number.
        gates: scaled to this world.
    """
    result = [-1] * len(targets)
    if not len(targets) or not len(candidates.boxes):
        return result
    cost = np.array(
        [
            _costs(target, box, candidates, frame, gates)
            for target, box in zip(targets, expected, strict=True)
        ]
    )
    for row, column in zip(*cheapest(cost), strict=True):
        result[row] = column
    return result


def cheapest(cost: FloatArray) -> tuple[list[int], list[int]]:
    """Return rows and columns of the cheapest assignment; what costs too much is left out."""
    if not cost.size:
        return [], []
    near = cost < _FAR
    if near.sum(axis=0).max() > 1 or near.sum(axis=1).max() > 1:
        # Loaded where something is to be weighed: it takes longer than following a short clip.
        from scipy.optimize import linear_sum_assignment

        rows, columns = linear_sum_assignment(cost)
        kept = near[rows, columns]
        rows, columns = rows[kept], columns[kept]
    else:
        rows, columns = np.nonzero(near)
    return rows.tolist(), columns.tolist()


def _costs(
    target: Target, box: FloatArray, candidates: Candidates, frame: int, gates: Gates
) -> FloatArray:
    gate = gates.gate_m if target.knows_motion else gates.new_gate_m
    gate += gates.gap_gate_m * (frame - target.frame - 1)
    # A step of half its size leaves an object overlapping itself.
    gate = max(gate, 0.5 * float(box[3:5].min()))
    place = box[:3]
    if target.rigid and target.offset is not None:
        place = place - target.offset
    apart = np.linalg.norm(candidates.boxes[:, :3] - place, axis=1) / gate
    named = np.array([name is not None and name == target.name for name in candidates.names])
    sizes = candidates.boxes[:, 3:6].prod(axis=1) / max(float(box[3:6].prod()), 1e-9)
    unlike = np.abs(np.log(np.maximum(sizes, 1e-9))) / 3
    near = apart <= np.where(named, gates.name_gates, 1.0)
    return np.where(near, apart + gates.size_cost * unlike - named, _FAR)
