"""Clips like CATER's, ray-cast when they are read: a pure function of the spec and the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from tcrdata.datasets.cater_scenes import build_clip
from tcrdata.datasets.cater_stage import FRAMES_PER_SECOND
from tcrdata.datasets.scene import Scene, View
from tcrdata.datasets.shading import render
from tcrdata.datasets.specs import Limits, format_spec
from tcrdata.datasets.tabletop import CAMERA, CAMERA_POSITION, LAMP, MAX_DEPTH_M
from tcrdata.datasets.views import level_view, looking_at
from tcrdata.geometry.raycasting import cast
from tcrdata.types import BoolArray, FloatArray, ImageArray, IntArray

VERSION = 1
JITTER_M = 0.5
CAMERAS_AROUND = 6
MISSING_BLOCK_PX = 4


@dataclass(frozen=True)
class CaterSpec:
    """Names a set of clips.

    Attributes:
        clips: how many.
        seed: of everything that is drawn.
        frames: a clip, 24 a second.
        cameras: that stand around the table, 60 degrees apart.
        hard: more objects on less room, some of them touching, and missing depth.
        noise_m: standard deviation of the depth.
        missing: share of pixels without depth, half of them in blocks of 4 by 4; -1 for none in
            easy clips and 0.1 in hard ones.
    """

    clips: int = 1
    seed: int = 1
    frames: int = 50
    cameras: int = CAMERAS_AROUND
    hard: bool = False
    noise_m: float = 0.05
    missing: float = -1.0

    @property
    def missing_share(self) -> float:
        """Share of the pixels without depth."""
        if self.missing >= 0:
            return self.missing
        return 0.1 if self.hard else 0.0


LIMITS = {
    "clips": Limits(1, 10_000),
    "seed": Limits(0, 2**31 - 1),
    "frames": Limits(1, 100_000),
    "cameras": Limits(1, CAMERAS_AROUND),
    "noise_m": Limits(0.0, 1.0),
    "missing": Limits(-1.0, 0.9),
}


@dataclass(frozen=True)
class GeneratedClips:
    """Clips that need no files; see `cater.Clips` for the methods.

    Attributes:
        spec: which.
    """

    spec: CaterSpec

    def names(self) -> list[str]:
        """Names of the clips, sorted."""
        return [f"clip_{number:04d}" for number in range(self.spec.clips)]

    def has(self, clip: str, camera: int) -> bool:
        """Whether there is such a camera."""
        return clip in self.names() and camera < self.spec.cameras

    def cameras(self, clip: str) -> int:  # noqa: ARG002
        """Number of cameras."""
        return self.spec.cameras

    def numbers(self, clip: str, camera: int) -> list[int]:  # noqa: ARG002
        """Numbers of the frames."""
        return list(range(self.spec.frames))

    def frames_per_second(self, clip: str) -> float:  # noqa: ARG002
        """Frames a second."""
        return float(FRAMES_PER_SECOND)

    def calibration(self, clip: str) -> str:  # noqa: ARG002
        """Where the cameras' places come from."""
        return "generated"

    def identity(self, clip: str, camera: int) -> str:  # noqa: ARG002
        """Text that everything in the clip follows from."""
        named = format_spec(replace(self.spec, clips=1))
        return f"cater version {VERSION}: {named}: {clip}"

    def paths(self, clip: str, camera: int, frame: int) -> tuple[None, None]:  # noqa: ARG002
        """No files."""
        return None, None

    def faults(self, clip: str, camera: int, frame: int) -> tuple[None, None]:  # noqa: ARG002
        """Nothing is wrong."""
        return None, None

    def view(self, clip: str, camera: int) -> View:
        """Return a camera, its level frame and the world."""
        return _view(self.spec.seed, self._number(clip), camera)

    def scene(self, clip: str) -> Scene:
        """Return the objects and where they are at any time: truth."""
        return _scene(self.spec.seed, self._number(clip), self.spec.frames, self.spec.hard)

    def depth(self, clip: str, camera: int, frame: int) -> FloatArray:
        """Return the (H, W) depth in metres with its noise and gaps; 0 where there is none."""
        depth, _ = self.geometry(clip, camera, frame)
        random = np.random.default_rng([self.spec.seed, self._number(clip), camera, frame])
        depth = depth + self.spec.noise_m * random.standard_normal(depth.shape)
        missing = _missing(random, depth.shape, self.spec.missing_share)
        return np.where((depth <= 0) | (depth > MAX_DEPTH_M) | missing, 0.0, depth)

    def geometry(self, clip: str, camera: int, frame: int) -> tuple[FloatArray, IntArray]:
        """Return (H, W) exact depth (m) and numbers of `scene.parts`; inf and -1 for nothing."""
        view = self.view(clip, camera)
        primitives = self.scene(clip).primitives(frame / FRAMES_PER_SECOND)
        depth, parts = cast(primitives, view.origin, view.rays())
        shape = (view.camera.height_px, view.camera.width_px)
        return depth.reshape(shape), parts.reshape(shape)

    def image(self, clip: str, camera: int, frame: int) -> ImageArray:
        """Return the (H, W, 3) RGB image, four rays a pixel."""
        view, scene = self.view(clip, camera), self.scene(clip)
        return render(
            scene.primitives(frame / FRAMES_PER_SECOND),
            scene.materials(),
            LAMP,
            view.origin,
            view.pixel_rays,
            (view.camera.width_px, view.camera.height_px),
        )

    def _number(self, clip: str) -> int:
        return int(clip.rpartition("_")[2])


def _missing(random: np.random.Generator, shape: tuple[int, ...], share: float) -> BoolArray:
    """Draw (H, W) pixels without depth: half of them alone, half in blocks."""
    each = 1.0 - np.sqrt(1.0 - share)
    blocks = random.random((-(-shape[0] // MISSING_BLOCK_PX), -(-shape[1] // MISSING_BLOCK_PX)))
    side = np.ones((MISSING_BLOCK_PX, MISSING_BLOCK_PX), dtype=bool)
    gone = np.kron(blocks < each, side)[: shape[0], : shape[1]]
    return np.asarray(gone | (random.random(shape) < each), dtype=np.bool_)


@lru_cache(maxsize=4)
def _scene(seed: int, number: int, frames: int, hard: bool) -> Scene:
    return build_clip(seed, number, frames, hard)


@lru_cache(maxsize=24)
def _view(seed: int, number: int, camera: int) -> View:
    """Place a camera on the circle of CATER's, shifted a little, looking at the table's middle."""
    random = np.random.default_rng([seed, number, 77, camera])
    turn = camera * 2 * math.pi / CAMERAS_AROUND
    c, s = math.cos(turn), math.sin(turn)
    x, y, z = CAMERA_POSITION
    place = np.array([c * x - s * y, s * x + c * y, z]) + random.uniform(-JITTER_M, JITTER_M, 3)
    return level_view(CAMERA, looking_at(place, np.zeros(3)))
