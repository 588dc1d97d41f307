"""Frames to what a detector learns from: an input grid, its targets, and where they are known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import ndimage

from tcrdata import registry
from tcrdata.errors import SettingsError
from tcrdata.geometry.boxes import points_in_box
from tcrdata.learning.augmentation import (
    SweepAugmentation,
    SweepChange,
    drawn_change,
    erased_points,
)
from tcrdata.learning.clouds import Cloud, owners, points_of_labels
from tcrdata.learning.pasting import labelled_objects, with_copies
from tcrdata.networks.center_targets import LabelBoxes, TargetSettings
from tcrdata.networks.grids import Region, Sweep, pixel_colours, projected
from tcrdata.types import BOX_COLUMNS, BoolArray, Float32Array

NEGATIVES = ("near", "sure", "everywhere")


@dataclass(frozen=True)
class DetectorSamples:
    """Makes a sample of a row of `queries/training/detector.sql`; picklable.

    Attributes:
        network: name of the detector.
        network_settings: its settings.
        augmentation: of the sweeps.
        targets: shape of the targets.
    """

    network: str
    network_settings: Any
    augmentation: SweepAugmentation = field(default_factory=SweepAugmentation)
    targets: TargetSettings = field(default_factory=TargetSettings)

    def __call__(self, row: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        """Return `input`, the targets of the network, and `key` (which frame it is)."""
        module = registry.find("networks", self.network)
        region = self.network_settings.region.coarser(self.network_settings.stride)
        change = drawn_change(self.augmentation, rng)
        cloud, labels = self._changed(row, change, region, rng)
        unsure = cloud.xyz[unsure_points(row, cloud, labels)]
        known = known_background(row, unsure, labels, region)
        made = module.targets_of(labels, known, self.network_settings, self.targets)
        colours = pixel_colours(row.get("image"), row["camera"], row["points"])[cloud.origin]
        height = cloud.height_m + np.float32(change.shift_m)
        sweep = Sweep(cloud.xyz, height, cloud.ground, colours)
        key = f"{row['dataset']}/{row['sequence']}/{row['frame']:06d}"
        return {"input": module.image_of(sweep, self.network_settings), **made, "key": key}

    def _changed(
        self,
        row: dict[str, Any],
        change: SweepChange,
        region: Region,
        rng: np.random.Generator,
    ) -> tuple[Cloud, LabelBoxes]:
        """Return the points left in the region and the labels, both at their new places."""
        labels, own = label_boxes(row), self.augmentation
        cloud = cloud_of(row, labels)
        dropped = rng.random(len(cloud.xyz), dtype=np.float32) < change.dropped_share
        cloud = cloud.chosen(~dropped)
        scaled = cloud.height_m * np.float32(change.scale)
        whole = replace(cloud, xyz=change.points(cloud.xyz), height_m=scaled)
        kept = np.flatnonzero(region.cells(whole.xyz[:, 0], whole.xyz[:, 2])[1])
        shown, labels = whole.chosen(kept), change.labels(labels)
        if not own.enabled:
            return shown, labels
        counts = points_of_labels(shown.owner, len(labels))
        if own.erased_px > 0:
            seen = cloud.chosen(kept)
            pixels = projected(row["camera"], seen.xyz * np.float32(row["metric_scale"]))
            shown = shown.chosen(~erased_points(seen, pixels, own, rng))
        objects = labelled_objects(whole)
        return with_copies(shown, labels, objects, counts, region, own, rng)


def cloud_of(row: dict[str, Any], labels: LabelBoxes) -> Cloud:
    """Return the points of a row, in metres of a road scene, and whose of its labels they are."""
    scale = np.float32(row["metric_scale"])
    height, xyz = row["height_m"].astype(np.float32) / scale, row["points"] / scale
    owner = owners(xyz, row["ground"], labels)
    return Cloud(xyz, height, row["ground"], np.arange(len(height)), owner)


def label_boxes(row: dict[str, Any]) -> LabelBoxes:
    """Return the labels of a row, in metres of a road scene."""
    listed = row["labels"] or []
    boxes = np.array([[label[name] for name in BOX_COLUMNS] for label in listed], dtype=np.float64)
    boxes = boxes.reshape(-1, 7)
    boxes[:, :6] /= row["metric_scale"]
    positive = np.array([label["positive"] for label in listed], dtype=bool)
    moving = np.array([label.get("moving", False) for label in listed], dtype=bool)
    return LabelBoxes(boxes, positive, moving)


def unsure_points(row: dict[str, Any], cloud: Cloud, labels: LabelBoxes) -> BoolArray:
    """Return (N,) which points may belong to an object nobody has labelled.

    Those are not ground, not surely static by the row's bound, and in no positive label.
    """
    static, free = (row[name][cloud.origin] for name in ("votes_static", "votes_free"))
    surely = (static >= row["least_static_votes"]) & (static > free)
    unsure = np.asarray(~cloud.ground & ~surely)
    for box in labels.boxes[labels.positive]:
        unsure[points_in_box(cloud.xyz, box, 0.3)] = False
    return unsure


def known_background(
    row: dict[str, Any], unsure_xyz: Float32Array, labels: LabelBoxes, region: Region
) -> BoolArray:
    """Return (rows, columns) where no object has its centre, by the row's kind of negatives.

    Args:
        row: has `negatives`, `near_m` and `unsure_reach_m`.
        unsure_xyz: (N, 3) points that may belong to an unlabelled object.
        labels: of the frame.
        region: the ground covered, in output cells.

    Raises:
        SettingsError: there are no such negatives.
    """
    kind = row["negatives"]
    if kind not in NEGATIVES:
        raise SettingsError(f"negatives is '{kind}': choose one of {', '.join(NEGATIVES)}")
    shape = (region.rows, region.columns)
    if kind == "everywhere":
        return np.ones(shape, dtype=bool)
    x, z = region.centers()
    known = np.zeros(shape, dtype=bool)
    for box in labels.boxes[labels.positive]:
        reach = np.hypot(box[3], box[4]) / 2 + row["near_m"]
        known |= np.hypot(x[None] - box[0], z[:, None] - box[2]) <= reach
    if kind == "near":
        return known
    cells, inside = region.cells(unsure_xyz[:, 0], unsure_xyz[:, 2])
    free = np.ones(region.rows * region.columns, dtype=bool)
    free[cells[inside]] = False
    if free.all():
        return np.ones(shape, dtype=bool)
    distance = ndimage.distance_transform_edt(free.reshape(shape)) * region.cell_m
    return np.asarray(known | (distance > row["unsure_reach_m"]))
