"""Several looks at one scene, each turned about the sensor, and the boxes that they agree on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import bev_iou, half_turn
from tcrdata.geometry.transforms import level_transformed, yaw_rotation
from tcrdata.networks.decoding import Detections
from tcrdata.networks.grids import Region
from tcrdata.types import FloatArray, IntArray


def turned_points(xyz: NDArray[np.floating], turn_rad: float) -> NDArray[np.floating]:
    """Return (N, 3) level points turned about the sensor so that yaws grow by an angle."""
    return level_transformed(yaw_rotation(turn_rad), xyz)


def turned_boxes(boxes: FloatArray, turn_rad: float) -> FloatArray:
    """Return (N, 7) boxes turned as `turned_points` turns points; y may be NaN."""
    made = boxes.copy()
    made[:, :3] = turned_points(boxes[:, :3], turn_rad)
    made[:, 6] += turn_rad
    return made


def fused(
    looks: Sequence[Detections], turns_rad: Sequence[float], region: Region, same_iou: float
) -> Detections:
    """Return the boxes of several looks, those of one object as their mean, surest first.

    A box and its score are means weighted by score (weighted boxes fusion: Solovyev et al., 2021);
    a look that covers the place and has no box there counts as one with score 0.

    Args:
        looks: the boxes of each, turned back to the scene.
        turns_rad: how the scene was turned for each; the first look is the straight one.
        region: the ground that a look covers; what the straight one does not is left out.
        same_iou: boxes that overlap more, from above, are one object's.
    """
    boxes = np.concatenate([look.boxes for look in looks])
    scores = np.concatenate([look.scores for look in looks])
    inside = region.cells(boxes[:, 0], boxes[:, 2])[1]
    boxes, scores = boxes[inside], scores[inside]
    covering = np.zeros(len(boxes), dtype=np.int64)
    for turn_rad in turns_rad:
        there = turned_boxes(boxes, turn_rad)
        covering += region.cells(there[:, 0], there[:, 2])[1]
    groups = _groups(boxes, scores, same_iou)
    means = np.array([_mean(boxes[group], scores[group]) for group in groups]).reshape(-1, 7)
    sums = [scores[group].sum() / max(covering[group[0]], len(group)) for group in groups]
    surest = np.argsort(-np.array(sums), kind="stable")
    return Detections(means[surest], np.array(sums)[surest])


def _groups(boxes: FloatArray, scores: FloatArray, same_iou: float) -> list[IntArray]:
    """Return numbers of the boxes of each object, the surest first."""
    overlap = bev_iou(boxes, boxes)
    groups: dict[int, list[int]] = {}
    for number in np.argsort(-scores, kind="stable").tolist():
        leader = max(groups, key=lambda first: overlap[number, first], default=number)
        if leader != number and overlap[number, leader] > same_iou:
            groups[leader].append(number)
        else:
            groups[number] = [number]
    return [np.array(members) for members in groups.values()]


def _mean(boxes: FloatArray, scores: FloatArray) -> FloatArray:
    """Return the weighted mean of (N, 7) boxes; the first says which way the yaw heads."""
    share = scores / scores.sum()
    mean: FloatArray = share @ boxes
    mean[3:6] = np.exp(share @ np.log(boxes[:, 3:6]))
    turns = [half_turn(yaw - boxes[0, 6]) for yaw in boxes[:, 6]]
    mean[6] = boxes[0, 6] + share @ np.array(turns)
    return mean
