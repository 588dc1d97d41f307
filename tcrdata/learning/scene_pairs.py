"""Generated image pairs with exact flow: two moments of a generated scene, cut to one size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata import registry
from tcrdata.errors import SettingsError
from tcrdata.learning.textured_planes import FlowPair, PlaneSettings, photographed
from tcrdata.types import BoolArray, Float32Array, ImageArray

FIRST_SEED = 1_000
"""Scenes of lower seeds are left to those who score."""

LAST_SEED = 2**31
ROOTS = {
    "demo": "seed={seed},frames={frames}",
    "cater": "seed={seed},frames={frames},cameras=1",
    "street": "seed={seed},frames={frames},speed_mps={speed:.3f}",
}
"""Datasets that know their flow, and how a scene of theirs is named."""


@dataclass(frozen=True)
class SceneSettings:
    """Which pairs show a generated scene in place of planes.

    Attributes:
        share: of the pairs.
        datasets: whose scenes are drawn, each as often as the others: demo, cater, street.
        frames: of a scene.
        apart: at most so many frames lie between the images.
        moving: share of the pieces that are cut about something that moves.
        fastest_mps: of the own car on a street.
    """

    share: float = 0.0
    datasets: tuple[str, ...] = ("demo", "cater", "street")
    frames: int = 25
    apart: int = 2
    moving: float = 0.7
    fastest_mps: float = 12.0

    def __post_init__(self) -> None:
        for name in self.datasets:
            if name not in ROOTS:
                raise SettingsError(f"scenes.datasets: '{name}' is none of {', '.join(ROOTS)}")
        if self.share > 0 and not self.datasets:
            raise SettingsError("scenes.datasets: none is left; leave scenes out by scenes.share=0")
        if not 1 <= self.apart < self.frames:
            raise SettingsError(
                f"scenes.apart={self.apart}: a scene of {self.frames} frames needs 1 to "
                f"{self.frames - 1}"
            )


def scene_pair(own: SceneSettings, planes: PlaneSettings, rng: np.random.Generator) -> FlowPair:
    """Return a pair drawn with these random numbers, no larger than pairs of planes are.

    Args:
        own: which scenes.
        planes: size of the piece, and what light and noise do to each image.
        rng: of all that is drawn.
    """
    name = own.datasets[int(rng.integers(len(own.datasets)))]
    root = ROOTS[name].format(
        seed=int(rng.integers(FIRST_SEED, LAST_SEED)),
        frames=own.frames,
        speed=rng.uniform(0, own.fastest_mps),
    )
    dataset = registry.find("datasets", name).open_dataset(root)
    frames = dataset.frames(dataset.sequences()[0])
    apart = int(rng.integers(1, own.apart + 1))
    start = int(rng.integers(own.frames - apart))
    # Half of the pairs are turned round in time: what comes into view is learnt as what goes.
    order = (start, start + apart) if rng.random() < 0.5 else (start + apart, start)
    first, second = (frames[number] for number in order)
    flow = dataset.exact_flow(first, second)
    # Where something passes close by it goes farther than a piece can show: nothing to learn there.
    known = np.hypot(flow[..., 0], flow[..., 1]) <= planes.width_px / 2
    flow = np.where(known[..., None], flow, np.float32(0))
    piece = _piece(flow, own, planes, rng)
    here, there = (unit_colours(dataset.read_image(frame)[piece]) for frame in (first, second))
    return FlowPair(*photographed(here, there, planes, rng), flow[piece], known[piece])


def _piece(
    flow: Float32Array, own: SceneSettings, planes: PlaneSettings, rng: np.random.Generator
) -> tuple[slice, slice]:
    """Where to cut: about a pixel that moves, or anywhere."""
    moving: BoolArray = np.hypot(flow[..., 0], flow[..., 1]) > 0.5
    places = np.argwhere(moving if moving.any() and rng.random() < own.moving else ~moving)
    height, width = flow.shape[:2]
    middle = places[int(rng.integers(len(places)))] if len(places) else (height // 2, width // 2)
    cut = []
    for place, size, wanted in zip(
        middle, (height, width), (planes.height_px, planes.width_px), strict=True
    ):
        first = int(np.clip(place - wanted // 2, 0, max(0, size - wanted)))
        cut.append(slice(first, first + wanted))
    return cut[0], cut[1]


def unit_colours(image: ImageArray) -> Float32Array:
    """Return (H, W, 3) colours in [0, 1] of an image of bytes."""
    return np.asarray(image / np.float32(255), dtype=np.float32)
