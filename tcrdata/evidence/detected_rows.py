"""Rows of standing objects that a detector found: keys, what the whole object has, confidences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcrdata.evidence.detection_groups import Group
from tcrdata.evidence.proposal_columns import Columns, key_columns, merged, of_round
from tcrdata.types import Frame

SOURCE, FIT = "detected", "persistent"


def key_rows(
    frame: Frame,
    groups: Sequence[Group],
    numbers: Sequence[int],
    metric_scale: float,
    round: int,
) -> Columns:
    """Return ids, and how far the frame is from the nearest detection of each object."""
    own = [groups[number] for number in numbers]
    gaps = [int(np.abs(np.array(group.frames) - frame.frame).min()) for group in own]
    base = f"{frame.dataset}/{frame.sequence}/{of_round(SOURCE, round)}"
    return merged(
        key_columns(frame, SOURCE, FIT, numbers, metric_scale, round),
        {
            "track_id": [f"{base}/{number:04d}" for number in numbers],
            "found": [_found(group, frame.frame) for group in own],
            "frames_from_observation": gaps,
        },
    )


def _found(group: Group, frame: int) -> str:
    if frame in group.frames:
        return "observed"
    return "gap" if group.frames[0] < frame < group.frames[-1] else "extended"


def statistics(
    groups: Sequence[Group],
    frames: Sequence[tuple[int, tuple[int, ...], Columns]],
    hidden_share: float,
) -> dict[str, list[Any]]:
    """Return the columns that are the same in all rows of an object, an entry an object.

    Args:
        groups: the objects.
        frames: frame, numbers of its objects, and their columns.
        hidden_share: a place of which more is hidden cannot be seen.
    """
    visible = [set(group.frames) for group in groups]
    shares: list[list[float]] = [[] for _ in groups]
    points: list[list[int]] = [[] for _ in groups]
    ranges: list[list[float]] = [[] for _ in groups]
    for frame, numbers, columns in frames:
        for i, number in enumerate(numbers):
            hidden = columns["occluded_share"][i]
            if hidden is not None and hidden <= hidden_share:
                visible[number].add(frame)
            if columns["core_share"][i] is not None:
                shares[number].append(columns["core_share"][i])
            points[number].append(columns["number_of_points"][i])
            ranges[number].append(columns["range_m"][i])
    return {
        "age_frames": [len(group.frames) for group in groups],
        "span_frames": [group.frames[-1] - group.frames[0] + 1 for group in groups],
        "visible_frames": [len(seen) for seen in visible],
        "visible_share": [
            len(group.frames) / len(seen) for group, seen in zip(groups, visible, strict=True)
        ],
        "best_half_score": [group.best_half_score for group in groups],
        "refinement_residual_m": [group.spread_m for group in groups],
        "track_core_share": [float(np.median(s)) if s else None for s in shares],
        "track_points": [float(np.median(p)) if p else None for p in points],
        "track_range_min_m": [min(r) if r else None for r in ranges],
        "travel_m": [0.0] * len(groups),
        "path_length_m": [0.0] * len(groups),
        "speed_mps": [0.0] * len(groups),
    }


def persistence(group: Group) -> float:
    """Return how surely something stands there, in [0, 1].

    The best half's score * (1 - 2^(-age / 4 frames)): half of it at four sightings.
    """
    return group.best_half_score * (1 - math.pow(2.0, -len(group.frames) / 4))


def confidence_columns(
    rows: Columns, groups: Sequence[Group], numbers: Sequence[int], frame: int
) -> list[Columns]:
    """Return rows of two modules for one frame's objects.

    persistence: see `persistence`. objectness_3d: the detection's score; none in frames without.
    """
    count = len(numbers)
    keys = {name: rows[name] for name in ("proposal_id", "frame", "source")}
    scores = [dict(zip(groups[n].frames, groups[n].scores, strict=True)) for n in numbers]
    detected = [score.get(frame) for score in scores]
    return [
        {
            **keys,
            "module": ["persistence"] * count,
            "confidence": [persistence(groups[number]) for number in numbers],
            "raw_value": rows["best_half_score"],
            "unit": ["probability of a centre"] * count,
        },
        {
            **keys,
            "module": ["objectness_3d"] * count,
            "confidence": detected,
            "raw_value": detected,
            "unit": ["probability of a centre"] * count,
        },
    ]
