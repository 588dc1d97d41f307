"""Changes that leave a label true: of sweeps with their boxes, and of images with their masks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.transforms import level_transformed, yaw_rotation
from tcrdata.learning.clouds import Cloud, points_of_labels, still_shown
from tcrdata.networks.center_targets import LabelBoxes
from tcrdata.types import BoolArray, Float32Array, FloatArray


@dataclass(frozen=True)
class SweepAugmentation:
    """How a sweep is changed; nothing is when `enabled` is false.

    Attributes:
        enabled: whether to change anything.
        yaw_rad: the cloud turns about the sensor by up to this, either way.
        flip: mirror left and right, in half of the cases.
        scale: lengths grow or shrink by up to this share.
        dropped_share: up to this share of the points is left out.
        height_jitter_m: standard deviation of one shift of all heights above the ground.
        erased_px: side of the square of pixels that is erased near an object's centre, with the
            points that project into it; 0 erases none.
        erased_most: less than this share of an object's points goes, whether squares or copies
            of other objects take them: no labelled object is ever hidden whole.
        pasted: copies of labelled objects that are tried elsewhere in the sweep.
        pasted_farther: a copy is up to so many times as far away, and the sparser for it.
        pasted_stretch: each side of a copy grows or shrinks by up to this share.
        pasted_hidden_share: a copy of which nearer things hide more is dropped.
    """

    enabled: bool = True
    yaw_rad: float = np.pi
    flip: bool = True
    scale: float = 0.05
    dropped_share: float = 0.4
    height_jitter_m: float = 0.05
    erased_px: float = 20.0
    erased_most: float = 0.5
    pasted: int = 8
    pasted_farther: float = 2.0
    pasted_stretch: float = 0.25
    pasted_hidden_share: float = 0.5


@dataclass(frozen=True)
class SweepChange:
    """One draw of how a sweep and its labels change together.

    Attributes:
        turn_rad: added to every yaw, before the mirror.
        mirror: -1 where left and right change places, else 1.
        scale: factor of all lengths.
        shift_m: added to the heights above the ground.
        dropped_share: share of the points left out.
    """

    turn_rad: float = 0.0
    mirror: float = 1.0
    scale: float = 1.0
    shift_m: float = 0.0
    dropped_share: float = 0.0

    @property
    def matrix(self) -> FloatArray:
        """(3, 3): old to new places."""
        return self.scale * np.diag([self.mirror, 1.0, 1.0]) @ yaw_rotation(self.turn_rad)

    def points(self, xyz: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return (N, 3) points at their new places."""
        return level_transformed(self.matrix, xyz)

    def labels(self, labels: LabelBoxes) -> LabelBoxes:
        """Return the labels at their new places."""
        boxes = labels.boxes.copy()
        boxes[:, :3] = boxes[:, :3] @ self.matrix.T
        boxes[:, 3:6] *= self.scale
        boxes[:, 6] += self.turn_rad
        if self.mirror < 0:
            boxes[:, 6] = np.pi - boxes[:, 6]
        return replace(labels, boxes=boxes)


def drawn_change(settings: SweepAugmentation, rng: np.random.Generator) -> SweepChange:
    """Return a change drawn at random; none when augmentation is off."""
    if not settings.enabled:
        return SweepChange()
    return SweepChange(
        turn_rad=float(rng.uniform(-settings.yaw_rad, settings.yaw_rad)),
        mirror=-1.0 if settings.flip and rng.random() < 0.5 else 1.0,
        scale=float(rng.uniform(1.0 - settings.scale, 1.0 + settings.scale)),
        shift_m=float(rng.normal(0.0, settings.height_jitter_m)),
        dropped_share=float(rng.uniform(0.0, settings.dropped_share)),
    )


def erased_points(
    cloud: Cloud, pixels: FloatArray, settings: SweepAugmentation, rng: np.random.Generator
) -> BoolArray:
    """Return (N,) which points go when a square of pixels near each object's centre is erased.

    A square that would leave too little of any object, its own or another, is not erased.

    Args:
        cloud: points of the frame, as it was seen.
        pixels: (N, 2) where each point projects to; NaN where it does not.
        settings: the square's side, and how much of an object may go.
        rng: random numbers.
    """
    erased = np.zeros(len(pixels), dtype=bool)
    half = settings.erased_px / 2
    whole = points_of_labels(cloud.owner, 0)
    for number in range(len(whole)):
        shift = rng.uniform(-half, half, 2)
        own = pixels[cloud.owner == number]
        seen = own[np.isfinite(own[:, 0])]
        if not len(seen):
            continue
        center = (seen.min(axis=0) + seen.max(axis=0)) / 2 + shift
        more = np.abs(pixels[:, 0] - center[0]) <= half
        more &= np.abs(pixels[:, 1] - center[1]) <= half
        more |= erased
        left = points_of_labels(cloud.owner[~more], len(whole))
        if still_shown(left, whole, settings.erased_most):
            erased = more
    return erased


@dataclass(frozen=True)
class ImageAugmentation:
    """How an image is changed; nothing is when `enabled` is false.

    Attributes:
        enabled: whether to change anything.
        flip: mirror left and right, in half of the cases.
        zoom: the image grows or shrinks by up to this factor.
        brightness: added, up to this, of the range 0 to 1.
        contrast: the spread about the mean grows or shrinks by up to this share.
        saturation: the distance from grey grows or shrinks by up to this share.
        noise: standard deviation of noise.
        occlusions: at most so many rectangles are painted over.
        occlusion_px: largest side of one.
    """

    enabled: bool = True
    flip: bool = True
    zoom: float = 1.4
    brightness: float = 0.15
    contrast: float = 0.3
    saturation: float = 0.5
    noise: float = 0.03
    occlusions: int = 3
    occlusion_px: float = 40.0


def image_placement(
    settings: ImageAugmentation,
    shape: tuple[int, int],
    crop: tuple[int, int],
    scale: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return (2, 3): pixels of the image to pixels of a crop, moved, scaled and maybe mirrored.

    Args:
        settings: how much.
        shape: height and width of the image.
        crop: height and width of the crop.
        scale: of the crop against the image, before any zoom.
        rng: random numbers.
    """
    mirror = False
    if settings.enabled:
        scale *= float(np.exp(rng.uniform(-1, 1) * np.log(settings.zoom)))
        mirror = settings.flip and rng.random() < 0.5
    room = np.array([crop[1] - shape[1] * scale, crop[0] - shape[0] * scale])
    place = rng.uniform(np.minimum(room, 0.0), np.maximum(room, 0.0))
    place = place if settings.enabled else room / 2
    if mirror:
        return np.array([[-scale, 0.0, place[0] + scale * shape[1]], [0.0, scale, place[1]]])
    return np.array([[scale, 0.0, place[0]], [0.0, scale, place[1]]])


def jittered(
    image: Float32Array, settings: ImageAugmentation, rng: np.random.Generator
) -> tuple[Float32Array, BoolArray]:
    """Return the image with other colours and painted over, and where it was painted over.

    Args:
        image: (H, W, 3) in [0, 1].
        settings: how much.
        rng: random numbers.
    """
    hidden: NDArray[np.bool_] = np.zeros(image.shape[:2], dtype=bool)
    if not settings.enabled:
        return image, hidden
    grey = image.mean(axis=2, keepdims=True)
    image = grey + (image - grey) * (1 + rng.uniform(-1, 1) * settings.saturation)
    mean = image.mean()
    image = mean + (image - mean) * (1 + rng.uniform(-1, 1) * settings.contrast)
    image = image + rng.uniform(-1, 1) * settings.brightness
    image = image + rng.standard_normal(image.shape, dtype=np.float32) * settings.noise
    for _ in range(int(rng.integers(0, settings.occlusions + 1))):
        height, width = (rng.uniform(0.2, 1.0, 2) * settings.occlusion_px).astype(int) + 1
        top, left = int(rng.integers(0, image.shape[0])), int(rng.integers(0, image.shape[1]))
        image[top : top + height, left : left + width] = rng.random(3)
        hidden[top : top + height, left : left + width] = True
    return np.clip(image, 0.0, 1.0).astype(np.float32), hidden
