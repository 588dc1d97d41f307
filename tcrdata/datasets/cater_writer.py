"""Writes clips into a folder in the layout of `cater_clips`; what is there whole is left."""

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
    """Write every image of the clips, one a step; a clip's calibration comes last.

    Args:
        clips: what to write.
        root: the folder, made when it is not there.

    Raises:
        DatasetError: the folder holds other clips of these names, or cannot be written.
    """
    for clip in clips.names():
        folder = Path(root) / clip
        steps = clips.cameras(clip) * clips.spec.frames
        try:
            if _is_there(folder, clips.identity(clip, 0)):
                yield from (None for _ in range(steps))
                continue
            for camera in range(clips.cameras(clip)):
                for frame in range(clips.spec.frames):
                    _write_images(clips, clip, folder, camera, frame)
                    yield
            rate = clips.frames_per_second(clip)
            _write_json(folder / TRUTH, scene_json(clips.scene(clip), clips.spec.frames, rate))
            _write_json(folder / CALIBRATION, _calibration(clips, clip))
        except OSError as error:
            raise DatasetError(f"{folder}: cannot be written: {error.strerror}") from error


def _is_there(folder: Path, source: str) -> bool:
    """Whether the very clip lies in a folder; raises DatasetError when another one does."""
    path = folder / CALIBRATION
    if not path.is_file():
        return False
    try:
        same = json.loads(path.read_text(encoding="utf-8")).get("source") == source
    except ValueError:
        same = False
    if not same:
        raise DatasetError(f"{folder} holds another clip: give another folder")
    return True


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
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(values) + "\n", encoding="utf-8")
    part.replace(path)
