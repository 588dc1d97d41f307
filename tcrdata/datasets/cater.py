"""Clips like CATER's: RGB and depth of a table from one to six static cameras.

The root is a folder of clips (`cater_clips` has its layout) or the spec of clips that are generated
when they are read, such as `clips=10,seed=3,hard=true`. Each camera of a clip is a sequence of its
own, `clip_0000_camera_0`, in its own level frame.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from tcrdata.datasets.blender import Blender, BlenderSettings
from tcrdata.datasets.cater_clips import RecordedClips
from tcrdata.datasets.cater_generator import LIMITS, CaterSpec, GeneratedClips
from tcrdata.datasets.cater_writer import Pictures, RayCaster, write_clips
from tcrdata.datasets.depth_points import unprojected
from tcrdata.datasets.scene import Scene, View
from tcrdata.datasets.specs import format_spec, parse_spec
from tcrdata.datasets.truth import exact_flow, truth_rows
from tcrdata.errors import DatasetError, SettingsError
from tcrdata.geometry.transforms import as_tuples, inverse
from tcrdata.settings import overridden, unknown
from tcrdata.types import (
    Float32Array,
    FloatArray,
    Frame,
    Generation,
    ImageArray,
    PointCloud,
    SequenceInfo,
)

METRIC_SCALE = 0.35
RENDERERS = ("raycast", "blender")
NO_OPTIONS: Mapping[str, str] = MappingProxyType({})
_CAMERA = "_camera_"


class Clips(Protocol):
    """Where clips come from; cameras and frames count from 0."""

    def names(self) -> list[str]:
        """Names of the clips, sorted."""
        ...

    def has(self, clip: str, camera: int) -> bool:
        """Whether there is such a camera."""
        ...

    def cameras(self, clip: str) -> int:
        """Number of cameras."""
        ...

    def numbers(self, clip: str, camera: int) -> list[int]:
        """Numbers of the frames, rising."""
        ...

    def frames_per_second(self, clip: str) -> float:
        """Frames a second."""
        ...

    def calibration(self, clip: str) -> str:
        """Where the cameras' places come from."""
        ...

    def identity(self, clip: str, camera: int) -> str:
        """Text that changes with anything that is read, but not with the truth."""
        ...

    def paths(self, clip: str, camera: int, frame: int) -> tuple[str | None, str | None]:
        """Paths of the image and the depth, relative to the root; None when generated."""
        ...

    def faults(self, clip: str, camera: int, frame: int) -> tuple[str | None, str | None]:
        """What is wrong with a frame, and what with its image alone."""
        ...

    def view(self, clip: str, camera: int) -> View:
        """Return a camera, its level frame and the world."""
        ...

    def scene(self, clip: str) -> Scene | None:
        """Return the objects and where they are at any time: truth; None without labels."""
        ...

    def depth(self, clip: str, camera: int, frame: int) -> FloatArray:
        """Return (H, W) depth in metres, 0 where there is none; raises FrameError."""
        ...

    def image(self, clip: str, camera: int, frame: int) -> ImageArray:
        """Return (H, W, 3) RGB; raises FrameError."""
        ...


def open_dataset(root: str | None = None) -> Cater:
    """Open a folder of clips, or generated ones: `root` is its path or their spec.

    Raises:
        DatasetError: no such folder, no clip in it, or the spec is malformed.
    """
    text = root or ""
    folder = Path(text).expanduser()
    if folder.is_dir() and text:
        # The store is read from other folders, too.
        root = str(folder.absolute())
        return Cater("cater", root, RecordedClips(root))
    if text and "=" not in text:
        raise DatasetError(
            f"{text}: no such folder; give a folder of clips, or name clips to generate like "
            f"{format_spec(CaterSpec())!r} (any of them may be left out)"
        )
    spec = parse_spec("cater", text, CaterSpec(), LIMITS)
    return Cater("cater", format_spec(spec), GeneratedClips(spec))


def generate(
    text: str, root: str, renderer: str = "raycast", options: Mapping[str, str] = NO_OPTIONS
) -> Generation:
    """Return the root of generated clips, and the work of writing them where they want a folder.

    Args:
        text: how many clips, or a spec such as `clips=10,seed=3,hard=true`.
        root: a folder that the clips are written to, unless they are there; empty for none: then
            they are generated whenever they are read, by the ray caster.
        renderer: what draws the images: `raycast` or `blender`.
        options: name and value of `BlenderSettings`, for `blender`.

    Raises:
        DatasetError: the spec is malformed; while working, the folder holds other clips, or they
            cannot be drawn.
        SettingsError: no such renderer, an option that it does not have, or no folder for it.
    """
    text = f"clips={text}" if text.strip().isdigit() else text
    spec = parse_spec("cater", text, CaterSpec(), LIMITS)
    pictures = _pictures(renderer, options)
    if not root:
        if renderer != "raycast":
            raise SettingsError(f"--renderer {renderer} draws into files: add --root FOLDER")
        return Generation(format_spec(spec), 0, iter(()))
    steps = spec.clips * spec.cameras * spec.frames
    return Generation(root, steps, write_clips(GeneratedClips(spec), root, pictures))


def _pictures(renderer: str, options: Mapping[str, str]) -> Pictures:
    """Return what draws; raises SettingsError."""
    if renderer == "blender":
        return Blender(overridden(BlenderSettings(), options, "blender"))
    if renderer != "raycast":
        raise SettingsError(unknown(f"renderer '{renderer}'", renderer, RENDERERS))
    if options:
        raise SettingsError(f"blender.{next(iter(options))}: only --renderer blender reads it")
    return RayCaster()


@dataclass(frozen=True)
class Cater:
    """The clips; see `tcrdata.types.Dataset` and `tcrdata.types.SeveralCameras` for the protocols.

    Attributes:
        name: `cater`.
        root: the folder, or the spec with every value written out.
        clips: where they come from.
    """

    name: str
    root: str
    clips: Clips

    def sequences(self) -> list[str]:
        """Names of the clips' cameras, sorted."""
        return [
            f"{clip}{_CAMERA}{camera}"
            for clip in self.clips.names()
            for camera in range(self.clips.cameras(clip))
        ]

    def info(self, sequence: str) -> SequenceInfo:
        """The camera's row; raises DatasetError for an unknown name."""
        clip, camera = self._parts(sequence)
        text = f"{self.clips.identity(clip, camera)}: camera {camera}"
        return SequenceInfo(
            dataset=self.name,
            sequence=sequence,
            root=self.root,
            sensor="depth",
            metric_scale=METRIC_SCALE,
            static_camera=True,
            calibration=self.clips.calibration(clip),
            fingerprint=hashlib.sha256(text.encode()).hexdigest(),
            number_of_frames=len(self.clips.numbers(clip, camera)),
        )

    def frames(self, sequence: str) -> list[Frame]:
        """Every frame in order."""
        clip, camera = self._parts(sequence)
        return [self._frame(clip, camera, number) for number in self.clips.numbers(clip, camera)]

    def simultaneous(self, frame: Frame) -> list[tuple[Frame, FloatArray]]:
        """Return the other cameras' frames of that moment, each with `level_T_other_level`."""
        clip, camera = self._parts(frame.sequence)
        level_T_world = self.clips.view(clip, camera).level_T_world
        return [
            (
                self._frame(clip, other, frame.frame),
                level_T_world @ inverse(self.clips.view(clip, other).level_T_world),
            )
            for other in range(self.clips.cameras(clip))
            if other != camera
        ]

    def read_points(self, frame: Frame) -> PointCloud:
        """Unproject the depth image; raises FrameError."""
        clip, camera = self._parts(frame.sequence)
        depth = self.clips.depth(clip, camera, frame.frame)
        view = self.clips.view(clip, camera)
        points, pixels = unprojected(depth, view.camera.matrix[:, :3], frame.sensor_matrix)
        return PointCloud(points, np.zeros(len(points), dtype=np.float32), pixels)

    def read_image(self, frame: Frame) -> ImageArray:
        """The frame's (H, W, 3) RGB image; raises FrameError."""
        clip, camera = self._parts(frame.sequence)
        return self.clips.image(clip, camera, frame.frame)

    def ground_truth(self, sequence: str) -> list[dict[str, Any]]:
        """A row for every object and frame, hidden ones too; see `truth.truth_rows`."""
        clip, camera = self._parts(sequence)
        scene, view = self.clips.scene(clip), self.clips.view(clip, camera)
        if scene is None:
            return []
        rate = self.clips.frames_per_second(clip)
        return [
            {"dataset": self.name, "sequence": sequence, "round": 1, **row}
            for number in self.clips.numbers(clip, camera)
            for row in truth_rows(scene, view, number / rate, number)
        ]

    def exact_flow(self, frame: Frame, frame_to: Frame) -> Float32Array | None:
        """Return the true (H, W, 2) flow in pixels between two frames; None without labels.

        This is truth, for scoring alone: no cue can reach it through the protocol. Surfaces are
        followed even where they become hidden; of files it is NaN beside the objects.
        """
        clip, camera = self._parts(frame.sequence)
        scene, view = self.clips.scene(clip), self.clips.view(clip, camera)
        if scene is None:
            return None
        rate = self.clips.frames_per_second(clip)
        return exact_flow(scene, view, frame.frame / rate, view, frame_to.frame / rate)

    def _frame(self, clip: str, camera: int, number: int) -> Frame:
        view = self.clips.view(clip, camera)
        image_path, points_path = self.clips.paths(clip, camera, number)
        error, image_error = self.clips.faults(clip, camera, number)
        return Frame(
            dataset=self.name,
            sequence=f"{clip}{_CAMERA}{camera}",
            frame=number,
            timestamp_ns=round(number * 1e9 / self.clips.frames_per_second(clip)),
            camera=view.camera,
            camera_T_level=as_tuples(view.camera_T_level),
            level_T_sensor=as_tuples(inverse(view.camera_T_level)),
            image_path=image_path,
            points_path=points_path,
            status="error" if error else "ok",
            error=error,
            image_error=image_error,
        )

    def _parts(self, sequence: str) -> tuple[str, int]:
        """The clip and the camera of a sequence."""
        clip, _, camera = sequence.rpartition(_CAMERA)
        if not camera.isdecimal() or not self.clips.has(clip, int(camera)):
            names = self.sequences()
            raise DatasetError(
                f"the cater dataset has no sequence {sequence!r}; it has {names[0]} to {names[-1]}"
            )
        return clip, int(camera)
