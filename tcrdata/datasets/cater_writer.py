"""Writes clips into a folder in the layout of `cater_clips`; what is there whole is left.

A clip that was begun holds `calibration.json.part` until it is whole; its images are left, too.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tcrdata.datasets.cater_clips import CALIBRATION, TRUTH, camera_json, image_file
from tcrdata.datasets.cater_generator import GeneratedClips
from tcrdata.datasets.cater_truth import scene_json
from tcrdata.errors import DatasetError

DEPTH_UNIT_M = 0.0005


class Pictures(Protocol):
    """What draws the RGB images of clips."""

    @property
    def look(self) -> str:
        """What decides the look of the images, in a line; empty for the ray caster."""
        ...

    def version(self) -> str:
        """Return which program draws; empty for this one."""
        ...

    def draw(
        self, clips: GeneratedClips, clip: str, folder: Path, steps: Sequence[tuple[int, int]]
    ) -> Generator[None, None, None]:
        """Write the image of each camera and frame, one an item; raises DatasetError."""
        ...


@dataclass(frozen=True)
class RayCaster:
    """Draws with the ray caster, textured by noise; see `Pictures` for the methods."""

    look: str = ""

    def version(self) -> str:
        """Return that it is tcrdata itself."""
        return ""

    def draw(
        self, clips: GeneratedClips, clip: str, folder: Path, steps: Sequence[tuple[int, int]]
    ) -> Generator[None, None, None]:
        """Write the image of each camera and frame, one an item."""
        for camera, frame in steps:
            image = clips.image(clip, camera, frame)
            _write_image(image_file(folder, camera, "rgb", frame), image)
            yield


def write_clips(clips: GeneratedClips, root: str, pictures: Pictures) -> Iterator[None]:
    """Write every image of the clips, one a step; a clip is read once its calibration is there.

    Args:
        clips: what to write.
        root: the folder, made when it is not there.
        pictures: what draws the images; depth is the ray caster's.

    Raises:
        DatasetError: the folder holds other files of these names, or cannot be written; or the
            images cannot be drawn.
    """
    version: str | None = None
    for clip in clips.names():
        folder = Path(root) / clip
        try:
            if _is_there(folder, _source(clips, clip, pictures)):
                yield from (None for _ in range(clips.cameras(clip) * clips.spec.frames))
                continue
            version = pictures.version() if version is None else version
            part = _begin(folder, _calibration(clips, clip, pictures, version))
            yield from _write_images(clips, clip, folder, pictures)
            rate = clips.frames_per_second(clip)
            _write_json(folder / TRUTH, scene_json(clips.scene(clip), clips.spec.frames, rate))
            part.replace(folder / CALIBRATION)
        except OSError as error:
            raise DatasetError(f"{folder}: cannot be written: {error.strerror}") from error


def _is_there(folder: Path, source: str) -> bool:
    """Whether the very clip lies in a folder, whole.

    Raises:
        DatasetError: another one does, or was begun, or the folder holds other files.
    """
    path = folder / CALIBRATION
    part = _part(path)
    whole = path.is_file()
    others = [entry for entry in folder.iterdir() if entry != part] if folder.is_dir() else []
    if others and _read(path if whole else part).get("source") != source:
        raise DatasetError(f"{folder} holds another clip: give another folder")
    return whole


def _read(path: Path) -> dict[str, Any]:
    """Return a calibration; empty where there is none."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}


def _begin(folder: Path, calibration: dict[str, Any]) -> Path:
    """Mark a folder as this clip's; return the file that is its calibration in the end.

    Raises:
        DatasetError: it was begun with another version of the program that draws.
    """
    part = _part(folder / CALIBRATION)
    before, now = _read(part).get("renderer"), calibration.get("renderer")
    if part.is_file() and before != now:
        raise DatasetError(f"{folder} was begun with {before}, this is {now}: give another folder")
    folder.mkdir(parents=True, exist_ok=True)
    part.write_text(json.dumps(calibration) + "\n", encoding="utf-8")
    return part


def _part(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def _write_images(
    clips: GeneratedClips, clip: str, folder: Path, pictures: Pictures
) -> Iterator[None]:
    """Write the images and depth that are not there yet; a step for each that is there then."""
    steps = [(c, f) for c in range(clips.cameras(clip)) for f in range(clips.spec.frames)]
    wanted = [step for step in steps if not image_file(folder, step[0], "rgb", step[1]).is_file()]
    todo = set(wanted)
    with closing(pictures.draw(clips, clip, folder, wanted)) as drawing:
        for camera, frame in steps:
            if (camera, frame) in todo:
                next(drawing)
            path = image_file(folder, camera, "depth", frame)
            if not path.is_file():
                steps_of_depth = np.rint(clips.depth(clip, camera, frame) / DEPTH_UNIT_M)
                _write_image(path, steps_of_depth.astype(np.uint16))
            yield


def _write_image(path: Path, pixels: NDArray[Any]) -> None:
    """Write a PNG that is there whole or not at all."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    part = _part(path)
    Image.fromarray(pixels).save(part, format="PNG", compress_level=3)
    part.replace(path)


def _source(clips: GeneratedClips, clip: str, pictures: Pictures) -> str:
    """What a clip's files follow from."""
    return ": ".join(filter(None, (clips.identity(clip, 0), pictures.look)))


def _calibration(
    clips: GeneratedClips, clip: str, pictures: Pictures, version: str
) -> dict[str, Any]:
    return {
        "frames_per_second": clips.frames_per_second(clip),
        "depth_unit_m": DEPTH_UNIT_M,
        "source": _source(clips, clip, pictures),
        **({"renderer": version} if version else {}),
        "cameras": [camera_json(clips.view(clip, n)) for n in range(clips.cameras(clip))],
    }


def _write_json(path: Path, values: dict[str, Any]) -> None:
    part = _part(path)
    part.write_text(json.dumps(values) + "\n", encoding="utf-8")
    part.replace(path)
