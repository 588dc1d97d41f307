"""A generated tabletop: RGB and depth from a static camera, with the exact truth; needs no files.

Textured spheres, boxes, cylinders and cones on a table slide, stop, tilt, are carried, and hide one
another; others never move. All of it is a pure function of the spec and the frame.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tcrdata.datasets.depth_points import unprojected
from tcrdata.datasets.scene import Scene, View
from tcrdata.datasets.shading import render
from tcrdata.datasets.specs import Limits, format_spec, parse_spec
from tcrdata.datasets.tabletop import (
    CAMERA,
    FRAMES_PER_SECOND,
    LAMP,
    MAX_DEPTH_M,
    build_scene,
    camera_axes,
)
from tcrdata.datasets.truth import exact_flow, truth_rows
from tcrdata.errors import DatasetError
from tcrdata.geometry.raycasting import cast
from tcrdata.geometry.transforms import as_tuples, inverse
from tcrdata.types import (
    Float32Array,
    FloatArray,
    Frame,
    ImageArray,
    IntArray,
    PointCloud,
    SequenceInfo,
)

VERSION = 1
METRIC_SCALE = 0.35


@dataclass(frozen=True)
class DemoSpec:
    """Names a set of clips.

    Attributes:
        seed: of everything that is drawn.
        frames: a clip.
        sequences: number of clips.
        noise_m: standard deviation of the depth.
    """

    seed: int = 1
    frames: int = 50
    sequences: int = 1
    noise_m: float = 0.01


LIMITS = {
    "seed": Limits(0, 2**31 - 1),
    "frames": Limits(1, 100_000),
    "sequences": Limits(1, 10_000),
    "noise_m": Limits(0.0, 1.0),
}


def open_dataset(root: str | None = None) -> Demo:
    """Open the demo; `root` names the scene, such as `seed=3,frames=50,sequences=2`.

    Raises:
        DatasetError: when the spec is malformed.
    """
    spec = parse_spec("demo", root, DemoSpec(), LIMITS)
    return Demo(name="demo", root=format_spec(spec), spec=spec)


@dataclass(frozen=True)
class Demo:
    """The generated clips; see `tcrdata.types.Dataset` for the protocol.

    Attributes:
        name: `demo`.
        root: the spec, every value written out.
        spec: the spec.
    """

    name: str
    root: str
    spec: DemoSpec

    def sequences(self) -> list[str]:
        """Names of the clips, sorted."""
        return [f"table_{number:04d}" for number in range(self.spec.sequences)]

    def info(self, sequence: str) -> SequenceInfo:
        """The clip's row; raises DatasetError for an unknown name."""
        self._number(sequence)
        text = f"demo version {VERSION}: {self.root}: {sequence}"
        return SequenceInfo(
            dataset=self.name,
            sequence=sequence,
            root=self.root,
            sensor="depth",
            metric_scale=METRIC_SCALE,
            static_camera=True,
            calibration="generated",
            fingerprint=hashlib.sha256(text.encode()).hexdigest(),
            number_of_frames=self.spec.frames,
        )

    def frames(self, sequence: str) -> list[Frame]:
        """Every frame in order, 24 a second."""
        self._number(sequence)
        camera_T_level, _ = camera_axes()
        return [
            Frame(
                dataset=self.name,
                sequence=sequence,
                frame=number,
                timestamp_ns=round(number * 1e9 / FRAMES_PER_SECOND),
                camera=CAMERA,
                camera_T_level=as_tuples(camera_T_level),
                level_T_sensor=as_tuples(inverse(camera_T_level)),
            )
            for number in range(self.spec.frames)
        ]

    def read_points(self, frame: Frame) -> PointCloud:
        """Unproject the noisy depth image; surfaces beyond 20 m give no point."""
        depth, _ = self._cast(frame.sequence, frame.frame)
        noise = np.random.default_rng([self.spec.seed, self._number(frame.sequence), frame.frame])
        depth = depth + self.spec.noise_m * noise.standard_normal(depth.shape)
        depth = np.where(depth > MAX_DEPTH_M, 0.0, depth)
        depth = depth.reshape(CAMERA.height_px, CAMERA.width_px)
        points, pixels = unprojected(depth, CAMERA.matrix[:, :3], frame.sensor_matrix)
        return PointCloud(points, np.zeros(len(points), dtype=np.float32), pixels)

    def read_image(self, frame: Frame) -> ImageArray:
        """The frame's (240, 320, 3) RGB image, four rays a pixel."""
        scene, view = self._scene(frame.sequence), _view()
        return render(
            scene.primitives(_time(frame.frame)),
            scene.materials(),
            LAMP,
            view.origin,
            view.pixel_rays,
            (CAMERA.width_px, CAMERA.height_px),
        )

    def ground_truth(self, sequence: str) -> list[dict[str, Any]]:
        """A row for every object and frame, hidden ones too; see `truth.truth_rows`."""
        scene, view = self._scene(sequence), _view()
        return [
            {"dataset": self.name, "sequence": sequence, "round": 1, **row}
            for number in range(self.spec.frames)
            for row in truth_rows(scene, view, _time(number), number)
        ]

    def exact_flow(self, frame: Frame, frame_to: Frame) -> Float32Array:
        """Return the true (H, W, 2) flow in pixels from one frame to another of the same clip.

        This is truth, for scoring alone: no cue can reach it through the protocol. Surfaces are
        followed even where they become hidden.
        """
        scene, view = self._scene(frame.sequence), _view()
        return exact_flow(scene, view, _time(frame.frame), view, _time(frame_to.frame))

    def exact_depth(self, frame: Frame) -> tuple[FloatArray, IntArray]:
        """Return the true (H, W) depth in metres and objects (-1 for the table): truth, as flow."""
        depth, owners = self._cast(frame.sequence, frame.frame)
        shape = (CAMERA.height_px, CAMERA.width_px)
        return depth.reshape(shape), owners.reshape(shape)

    def _cast(self, sequence: str, number: int) -> tuple[FloatArray, IntArray]:
        primitives = self._scene(sequence).primitives(_time(number))
        view = _view()
        depth, hits = cast(primitives, view.origin, view.rays())
        return depth, np.where(hits >= 0, primitives.owners[hits], -1)

    def _scene(self, sequence: str) -> Scene:
        return _scene(self.spec.seed, self._number(sequence), self.spec.frames)

    def _number(self, sequence: str) -> int:
        names = self.sequences()
        if sequence not in names:
            raise DatasetError(
                f"the demo dataset has no sequence {sequence!r}; it has {names[0]} to {names[-1]}"
            )
        return names.index(sequence)


@lru_cache(maxsize=8)
def _scene(seed: int, number: int, frames: int) -> Scene:
    return build_scene(seed, number, frames)


def _view() -> View:
    camera_T_level, level_T_world = camera_axes()
    return View(CAMERA, camera_T_level, level_T_world)


def _time(frame: int) -> float:
    return frame / FRAMES_PER_SECOND
