"""Draws generated clips with Blender, in CATER's look: rubber and metal under three soft lamps.

Depth stays the ray caster's, which is exact where Blender's polyhedra are off by a millimetre or
two, and more at their rims; that both see the same is looked at in a camera's first frame.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.datasets.blender_job import Wanted, scene_job
from tcrdata.datasets.blender_process import bpy_version, interpreter, rendered
from tcrdata.datasets.cater_clips import image_file
from tcrdata.datasets.cater_generator import GeneratedClips
from tcrdata.errors import RendererError, SettingsError

VERSION = 1
PART = ".blender"
TOLERANCE_M = 0.005
LEAST_AGREEMENT = 0.99


@dataclass(frozen=True)
class BlenderSettings:
    """How Blender renders.

    Attributes:
        samples: rays a pixel.
        denoise: whether Open Image Denoise smooths what few samples leave.
        threads: of the process; 0 for as many as it may use cores. Images do not depend on it.
        python: the interpreter that has bpy; empty for `TCRDATA_BLENDER_PYTHON`, or this one.
    """

    samples: int = 4
    denoise: bool = True
    threads: int = 0
    python: str = ""

    def __post_init__(self) -> None:
        if self.samples < 1 or self.threads < 0:
            raise SettingsError("blender.samples must be above 0, blender.threads 0 or more")


@dataclass(frozen=True)
class Blender:
    """Draws with Blender; see `cater_writer.Pictures` for the methods.

    Attributes:
        settings: how.
    """

    settings: BlenderSettings

    @property
    def look(self) -> str:
        """What decides the look of the images, apart from the version of bpy."""
        denoise = str(self.settings.denoise).lower()
        return f"blender version {VERSION}: samples={self.settings.samples},denoise={denoise}"

    def version(self) -> str:
        """Return which bpy draws; raises RendererError where there is none."""
        return f"bpy {bpy_version(interpreter(self.settings.python))}"

    def draw(
        self, clips: GeneratedClips, clip: str, folder: Path, steps: Sequence[tuple[int, int]]
    ) -> Generator[None, None, None]:
        """Write the image of each camera and frame, one an item.

        Raises:
            RendererError: bpy is missing, crashed, or sees another scene than the ray caster.
        """
        try:
            if steps:
                job = scene_job(clips, clip, _wanted(folder, steps)) | self._how(folder)
                for image in rendered(interpreter(self.settings.python), job):
                    if image["kind"] == "rgb":
                        yield
                    else:
                        _check_geometry(clips, clip, image)
        finally:
            for unfinished in folder.glob(f"*{PART}"):
                unfinished.unlink(missing_ok=True)

    def _how(self, folder: Path) -> dict[str, Any]:
        """Return the part of a job that says how it is rendered."""
        return {
            "samples": self.settings.samples,
            "denoise": self.settings.denoise,
            "threads": self.settings.threads or len(os.sched_getaffinity(0)),
            "part_path": str(folder.absolute() / f"image_{{}}{PART}"),
        }


def _wanted(folder: Path, steps: Sequence[tuple[int, int]]) -> list[Wanted]:
    """Return the images of the steps, and before a camera's first one what it sees there."""
    wanted: list[Wanted] = []
    for camera, frame in steps:
        if all(image.camera != camera for image in wanted):
            seen = folder / f"geometry_{camera}{PART}"
            wanted.append(Wanted(camera, frame, seen, "geometry"))
        wanted.append(Wanted(camera, frame, image_file(folder, camera, "rgb", frame)))
    return wanted


def _check_geometry(clips: GeneratedClips, clip: str, image: dict[str, Any]) -> None:
    """Compare what Blender sees in a frame with what the ray caster sees; remove the file.

    Raises:
        RendererError: at more than one pixel in a hundred another thing, or at another depth.
    """
    path, camera, frame = Path(image["path"]), image["camera"], image["frame"]
    depth_m, things = np.load(path)
    path.unlink()
    exact_m, parts = clips.geometry(clip, camera, frame)
    same = (things == parts) & ((parts < 0) | (np.abs(depth_m - exact_m) < TOLERANCE_M))
    if same.mean() < LEAST_AGREEMENT:
        raise RendererError(
            f"{clip} camera {camera}, frame {frame}: Blender and the ray caster see the same in "
            f"{same.mean():.1%} of the pixels alone; another version of bpy may do"
        )
