"""Frames to what a segmenter learns from: a crop of the image, and its pixels' labels.

Positive: the convex hull of the pixels that a label's points project to. Negative: the band around
it, and the pixels of points that are ground or surely static and in no label. The rest is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.boxes import points_in_box
from tcrdata.learning.augmentation import ImageAugmentation, image_placement, jittered
from tcrdata.networks.grids import projected
from tcrdata.networks.pyramid import STRIDE
from tcrdata.types import BOX_COLUMNS, BoolArray, FloatArray

_MARGIN_M = 0.1
_SPLAT_PX = 3


@dataclass(frozen=True)
class SegmenterSamples:
    """Makes a sample of a row of `queries/training/segmenter.sql`; picklable.

    Attributes:
        augmentation: of the images.
        height_px: of the crops; a multiple of 4.
        width_px: of the crops; a multiple of 4.
        scale: of the crops against the image.
    """

    augmentation: ImageAugmentation = field(default_factory=ImageAugmentation)
    height_px: int = 188
    width_px: int = 620
    scale: float = 0.5

    def __call__(self, row: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        """Return `input` (3, H, W), `objectness` and its weight (1, H / 4, W / 4), and `key`."""
        objects, known = pixel_labels(row)
        crop = (self.height_px, self.width_px)
        placed = image_placement(self.augmentation, row["image"].shape[:2], crop, self.scale, rng)
        size = (self.width_px, self.height_px)
        image = cv2.warpAffine(row["image"], placed, size, flags=cv2.INTER_AREA)
        image, hidden = jittered(image.astype(np.float32) / 255, self.augmentation, rng)
        coarse = placed / STRIDE
        small = (self.width_px // STRIDE, self.height_px // STRIDE)
        nearest = {"flags": cv2.INTER_NEAREST}
        objectness = cv2.warpAffine(objects.astype(np.uint8), coarse, small, **nearest)
        weight = cv2.warpAffine(known.astype(np.uint8), coarse, small, **nearest)
        weight[hidden[::STRIDE, ::STRIDE][: small[1], : small[0]] & (objectness == 0)] = 0
        return {
            "input": np.ascontiguousarray(np.moveaxis(image, 2, 0)),
            "objectness": objectness[None].astype(np.float32),
            "objectness_weight": weight[None].astype(np.float32),
            "key": f"{row['dataset']}/{row['sequence']}/{row['frame']:06d}",
        }


def pixel_labels(row: dict[str, Any]) -> tuple[BoolArray, BoolArray]:
    """Return (H, W) what is object, and where it is known whether it is."""
    shape = row["image"].shape[:2]
    pixels = projected(row["camera"], row["points"])
    seen = np.isfinite(pixels[:, 0])
    objects, ignored, band = (np.zeros(shape, dtype=np.uint8) for _ in range(3))
    labelled = np.zeros(len(pixels), dtype=bool)
    for label in row["labels"] or []:
        box = np.array([label[name] for name in BOX_COLUMNS], dtype=np.float64)
        inside = points_in_box(row["points"], box, _MARGIN_M * row["metric_scale"])
        labelled |= inside
        solid = inside & seen & ~row["ground"]
        _fill_hull(objects if label["positive"] else ignored, pixels[solid])
    reach = 2 * int(row["band_px"]) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    band = cv2.dilate(objects, kernel)
    sure = row["ground"] | (
        (row["votes_static"] >= row["least_static_votes"])
        & (row["votes_static"] > row["votes_free"])
    )
    background = _splatted(pixels[sure & seen & ~labelled], shape)
    known = (objects > 0) | (((band > 0) | background) & (ignored == 0))
    return objects > 0, known


def _fill_hull(mask: NDArray[np.uint8], pixels: FloatArray) -> None:
    """Fill the convex hull of (N, 2) pixels."""
    if len(pixels) >= 3:
        hull = cv2.convexHull(np.rint(pixels).astype(np.int32).reshape(-1, 1, 2))
        cv2.fillConvexPoly(mask, hull, 1)


def _splatted(pixels: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """Return (H, W) the pixels of points and their neighbours."""
    mask = np.zeros(shape, dtype=np.uint8)
    column, line = pixels.astype(np.int64).T
    mask[line, column] = 1
    return np.asarray(cv2.dilate(mask, np.ones((_SPLAT_PX, _SPLAT_PX), np.uint8)) > 0)
