"""Writes clips into a folder in the layout of `cater_clips`; what is there whole is left.

A clip that was begun holds `calibration.json.part` until it is whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.datasets.cater_clips import CALIBRATION, TRUTH, image_file
from tcrdata.datasets.cater_generator import GeneratedClips
from tcrdata.datasets.cater_truth import scene_json
from tcrdata.errors import DatasetError
from tcrdata.geometry.transforms import inverse

DEPTH_UNIT_M = 0.0005


def write_clips(clips: GeneratedClips, root: str) -> Iterator[None]:
    """Write every image of the clips, one a step; a clip is read once its calibration is there.

    Args:
        clips: what to write.
        root: the folder, made when it is not there.

    Raises:
        DatasetError: the folder holds other files of these names, or cannot be written.
    """
    for clip in clips.names():
        folder = Path(root) / clip
        steps = clips.cameras(clip) * clips.spec.frames
        try:
            if _is_there(folder, clips.identity(clip, 0)):
                yield from (None for _ in range(steps))
                continue
            part = _begin(folder, _calibration(clips, clip))
            for camera in range(clips.cameras(clip)):
                for frame in range(clips.spec.frames):
                    _write_images(clips, clip, folder, camera, frame)
                    yield
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
    if others and _source(path if whole else part) != source:
        raise DatasetError(f"{folder} holds another clip: give another folder")
    return whole


def _source(path: Path) -> object:
    """What a calibration was generated from; None where it does not say so."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    return values.get("source") if isinstance(values, dict) else None


def _begin(folder: Path, calibration: dict[str, Any]) -> Path:
    """Mark a folder as this clip's; return the file that is its calibration in the end."""
    folder.mkdir(parents=True, exist_ok=True)
    part = _part(folder / CALIBRATION)
    part.write_text(json.dumps(calibration) + "\n", encoding="utf-8")
    return part


def _part(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def _write_images(clips: GeneratedClips, clip: str, folder: Path, camera: int, frame: int) -> None:
    from PIL import Image

    depth = np.rint(clips.depth(clip, camera, frame) / DEPTH_UNIT_M).astype(np.uint16)
    for kind, pixels in (("rgb", clips.image(clip, camera, frame)), ("depth", depth)):
        path = image_file(folder, camera, kind, frame)
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(path, compress_level=3)


def _calibration(clips: GeneratedClips, clip: str) -> dict[str, Any]:
    cameras = []
    for number in range(clips.cameras(clip)):
        view = clips.view(clip, number)
        matrix = view.camera.matrix
        cameras.append(
            {
                "width_px": view.camera.width_px,
                "height_px": view.camera.height_px,
                "intrinsics_px": [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]],
                "world_T_camera": inverse(view.world_to_camera).tolist(),
            }
        )
    return {
        "frames_per_second": clips.frames_per_second(clip),
        "depth_unit_m": DEPTH_UNIT_M,
        "source": clips.identity(clip, 0),
        "cameras": cameras,
    }


def _write_json(path: Path, values: dict[str, Any]) -> None:
    part = _part(path)
    part.write_text(json.dumps(values) + "\n", encoding="utf-8")
    part.replace(path)
