"""Samples of flow: generated pairs, and a store's pairs with what a teacher says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tcrdata.errors import FrameError, SettingsError
from tcrdata.learning.scene_pairs import SceneSettings, scene_pair, unit_colours
from tcrdata.learning.stream import CountedSamples
from tcrdata.learning.taught_flows import TaughtFlows
from tcrdata.learning.textured_planes import PlaneSettings, textured_planes
from tcrdata.networks.flow_losses import FlowLossSettings
from tcrdata.types import BoolArray, Float32Array, ImageArray, IntArray

LEARNT, HELD_OUT = "learnt", "held out"


class GeneratedPairs:
    """Pairs that are drawn when they are asked for: the transform draws them."""

    def __len__(self) -> int:
        return 1

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return nothing but a name: all comes of the random numbers of the position."""
        return {"key": "generated"}

    def column(self, name: str) -> list[Any]:  # noqa: ARG002
        """Return a column of the pairs: there are no labels among them."""
        return [0]

    def drives(self) -> IntArray:
        """Return which drive each pair is of: there is one."""
        return np.zeros(1, dtype=np.int64)


@dataclass(frozen=True)
class GeneratedSamples:
    """Draws a pair and its mirror images: left to right, upside down and both.

    Their flows are opposite: a step that sees all four cannot learn which way things happened to
    move in it, which is most of what the few motions of a small batch would say.

    Attributes:
        planes: how pairs of planes are drawn.
        scenes: how many pairs show a scene instead, and which.
    """

    planes: PlaneSettings
    scenes: SceneSettings = field(default_factory=SceneSettings)

    def __call__(self, sample: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        """Return `input` (4, 6, H, W) in [0, 1], `flow` (4, 2, H, W) px, `known` (4, 1, H, W)."""
        # Without scenes the numbers drawn stay what they are without the setting.
        scene = self.scenes.share > 0 and rng.random() < self.scenes.share
        pair = (
            scene_pair(self.scenes, self.planes, rng)
            if scene
            else textured_planes(self.planes, rng)
        )
        images = np.concatenate([pair.first, pair.second], axis=2)
        known = pair.known[..., None].astype(np.float32)
        drawn: dict[str, list[Float32Array]] = {"input": [], "flow": [], "known": []}
        for across, down in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            flow = pair.flow * np.array([across, down], np.float32)
            for name, values in (("input", images), ("flow", flow), ("known", known)):
                drawn[name].append(_upright(values[::down, ::across]))
        return {**sample, **{name: np.stack(views) for name, views in drawn.items()}}


class StoredPairs:
    """The pairs of one part of the query `training/flow`, each with both images.

    A frame begins as many pairs as its column `steps` says: with the next one, the one after it...
    """

    def __init__(self, frames: CountedSamples, part: str) -> None:
        """Take those rows of a query's frames whose column `part` says so."""
        self._frames, self._part = frames, part

    def __len__(self) -> int:
        return len(self._places[0])

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return `first` and `second`, (H, W, 3) RGB, with their keys.

        Raises:
            FrameError: an image cannot be read, or the two differ in size.
        """
        starts, ends = self._places
        start, end = self._frames[int(starts[number])], self._frames[int(ends[number])]
        key = f"{start['dataset']}/{start['sequence']} frames {start['frame']}, {end['frame']}"
        if start["image"].shape != end["image"].shape:
            raise FrameError(f"{key}: images of two sizes; flow needs one: leave one of them out")
        kept = {name: start[name] for name in ("dataset", "sequence", "frame")}
        kept["frame_to"] = end["frame"]
        return {**kept, "key": key, "first": start["image"], "second": end["image"]}

    def column(self, name: str) -> list[Any]:
        """Return a column of the query for all pairs."""
        values = self._frames.column(name)
        return [values[place] for place in self._places[0]]

    def drives(self) -> IntArray:
        """Return which drive each pair is of, by number."""
        return self._frames.drives()[self._places[0]]

    @cached_property
    def _places(self) -> tuple[IntArray, IntArray]:
        """Where each pair's two frames are: all pairs of a frame, then those of the next."""
        chosen = np.array(self._frames.column("part")) == self._part
        steps = np.where(chosen, np.array(self._frames.column("steps"), np.int64), 0)
        starts = np.repeat(np.arange(len(steps)), steps)
        firsts = np.repeat(np.cumsum(steps) - steps, steps)
        return starts, starts + 1 + np.arange(len(starts)) - firsts


@dataclass(frozen=True)
class PairSettings:
    """What the student sees of a pair.

    Attributes:
        height_px: of the piece that is cut out.
        width_px: of it.
        margin_px: around it, where the student's flow may end.
        teacher_iterations: corrections that the teacher makes, on whole images.
        kept_mb: of what the teacher said, all processes of a training together; a pair of
            1242 x 375 px takes 8.4.
        scale: of the images before anything is cut.
        boxes: occlusions of one image, at most.
        least_box: smallest side of one, as a share of the piece's height.
        largest_box: largest.
        flip: mirror half of the pairs.
    """

    height_px: int = 160
    width_px: int = 448
    margin_px: int = 64
    teacher_iterations: int = 8
    kept_mb: float = 2200.0
    scale: float = 1.0
    boxes: int = 4
    least_box: float = 0.1
    largest_box: float = 0.4
    flip: bool = True

    def __post_init__(self) -> None:
        if min(self.height_px, self.width_px) < 64 or self.margin_px < 0 or not 0 < self.scale < 16:
            raise SettingsError(
                f"pairs of {self.width_px}x{self.height_px} px at scale {self.scale:g}, margin "
                f"{self.margin_px}: 64 px a side, a scale between 0 and 16 and no negative margin "
                "are needed"
            )
        if not 0 <= self.kept_mb < math.inf:
            raise SettingsError("pairs.kept_mb: 0 or more, and finite")
        if min(self.boxes, self.teacher_iterations) < 1:
            raise SettingsError("pairs.boxes and pairs.teacher_iterations: 1 or more")
        if not 0 < self.least_box <= self.largest_box < math.inf:
            raise SettingsError(
                "pairs.least_box and pairs.largest_box: above 0, finite, and the first no larger"
            )


@dataclass(frozen=True)
class TaughtSamples:
    """Cuts a piece of a pair and of its teacher's flow, and hides boxes from the student.

    Attributes:
        pairs: what is cut and hidden.
        taught: what the teacher says of clean, whole pairs.
        losses: nothing is hidden where occlusion is 0.
    """

    pairs: PairSettings
    taught: TaughtFlows
    losses: FlowLossSettings

    def __call__(self, sample: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        """Return `input` (6, H, W), `images` (2, 4, H + 2 m, W + 2 m) with a margin and a channel
        that is 1 where there is an image, `taught` (2, 2, H, W) px, and `trusted` and `hidden`
        (2, 1, H, W): forward, then backward.
        """  # noqa: D205
        own = self.pairs
        first, second = (_scaled(sample[name], own) for name in ("first", "second"))
        said = self.taught.of_pair(sample["key"], first, second)
        if own.flip and rng.random() < 0.5:
            first, second, said = first[:, ::-1], second[:, ::-1], said.mirrored()
        window, piece = _places(first.shape, own, rng)
        taught = [flow[piece] for flow in said.flows]
        around = [_framed(image, window, piece, own) for image in (first, second)]
        images = [unit_colours(image[piece]) for image in (first, second)]
        covers = [np.zeros(images[0].shape[:2], bool) for _ in range(2)]
        if self.losses.occlusion > 0:
            covers[int(rng.integers(2))] = _boxes(images[0].shape, own, rng)
        shown = [_covered(i, cover, rng) for i, cover in zip(images, covers, strict=True)]
        hidden = [
            covers[0] | _at_end(covers[1], taught[0]), covers[1] | _at_end(covers[0], taught[1])
        ]  # fmt: skip
        return {
            "key": sample["key"],
            "input": _upright(np.concatenate(shown, axis=2)),
            "images": np.stack([_upright(image) for image in around]),
            "taught": np.stack([_upright(flow) for flow in taught]),
            "trusted": np.stack([kept[piece] for kept in said.trusted])[:, None].astype(np.float32),
            "hidden": np.stack(hidden)[:, None].astype(np.float32),
        }


def _scaled(image: ImageArray, own: PairSettings) -> ImageArray:
    """The image at the scale, and no smaller than the piece: edges are repeated below and right."""
    import cv2

    if own.scale != 1:
        image = np.asarray(
            cv2.resize(image, None, fx=own.scale, fy=own.scale, interpolation=cv2.INTER_AREA)
        )
    below, right = max(0, own.height_px - len(image)), max(0, own.width_px - image.shape[1])
    if below or right:
        image = np.pad(image, ((0, below), (0, right), (0, 0)), mode="edge")
    return image


def _places(
    shape: tuple[int, ...], own: PairSettings, rng: np.random.Generator
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """A random piece of an image, with its margin and without."""
    windows, pieces = [], []
    for size, wanted in zip(shape, (own.height_px, own.width_px), strict=False):
        start = int(rng.integers(0, size - wanted + 1))
        end = start + wanted
        windows.append(slice(max(0, start - own.margin_px), min(size, end + own.margin_px)))
        pieces.append(slice(start, end))
    return (windows[0], windows[1]), (pieces[0], pieces[1])


def _framed(
    image: ImageArray,
    window: tuple[slice, slice],
    piece: tuple[slice, slice],
    own: PairSettings,
) -> Float32Array:
    """(H + 2 m, W + 2 m, 4): colours around a piece, and 1 where the image has any."""
    margin, seen = own.margin_px, image[window]
    size = (own.height_px + 2 * margin, own.width_px + 2 * margin)
    framed = np.zeros((*size, 4), np.float32)
    top, left = (
        margin - (inner.start - outer.start) for inner, outer in zip(piece, window, strict=True)
    )
    place = framed[top : top + len(seen), left : left + seen.shape[1]]
    place[..., :3], place[..., 3] = unit_colours(seen), 1
    return framed


def _boxes(shape: tuple[int, ...], own: PairSettings, rng: np.random.Generator) -> BoolArray:
    height, width = shape[:2]
    cover = np.zeros((height, width), bool)
    for _ in range(int(rng.integers(1, own.boxes + 1))):
        high, wide = (rng.uniform(own.least_box, own.largest_box, 2) * height).astype(int) + 1
        top, left = int(rng.integers(-high // 2, height)), int(rng.integers(-wide // 2, width))
        cover[max(0, top) : top + high, max(0, left) : left + wide] = True
    return cover


def _covered(image: Float32Array, cover: BoolArray, rng: np.random.Generator) -> Float32Array:
    """The image with noise about its mean colour where it is covered."""
    if not cover.any():
        return image
    noise = rng.standard_normal(image.shape, dtype=np.float32) * image.std() + image.mean(
        axis=(0, 1)
    )
    return np.where(cover[..., None], np.clip(noise, 0, 1), image).astype(np.float32)


def _at_end(cover: BoolArray, flow: Float32Array) -> BoolArray:
    """Where a flow ends in what is covered."""
    height, width = cover.shape
    rows, columns = np.indices((height, width))
    x = np.rint(columns + flow[..., 0]).clip(-1, width).astype(int)
    y = np.rint(rows + flow[..., 1]).clip(-1, height).astype(int)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    ends: BoolArray = inside & cover[y.clip(0, height - 1), x.clip(0, width - 1)]
    return ends


def _upright(image: Float32Array) -> Float32Array:
    """(H, W, C) to (C, H, W)."""
    return np.ascontiguousarray(np.moveaxis(image, 2, 0))
