"""The truth of a clip on disk: its objects' shapes and poses, written and read as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.datasets.scene import Containment, Part, Scene, SceneObject
from tcrdata.datasets.textures import Material
from tcrdata.errors import DatasetError
from tcrdata.types import FloatArray

SHAPES = ("sphere", "box", "cylinder", "cone")
_PLAIN = Material((0.5, 0.5, 0.5))


@dataclass(frozen=True)
class Recorded:
    """Where an object was in every frame; between frames its place is interpolated.

    Attributes:
        poses: `world_T_object` (4, 4) of frames 0, 1, ... as nested tuples.
        frames_per_second: of the clip.
    """

    poses: tuple[tuple[tuple[float, ...], ...], ...]
    frames_per_second: float

    def pose(self, time_s: float) -> FloatArray:
        """Return the pose at a time: rotated as in the nearest frame."""
        frame = min(max(time_s * self.frames_per_second, 0.0), len(self.poses) - 1.0)
        before = min(int(frame), max(len(self.poses) - 2, 0))
        pose = np.array(self.poses[round(frame)], dtype=np.float64)
        first, second = (
            np.array(self.poses[n]) for n in (before, min(before + 1, len(self.poses) - 1))
        )
        pose[:3, 3] = first[:3, 3] + (frame - before) * (second[:3, 3] - first[:3, 3])
        return pose


def scene_json(scene: Scene, frames: int, frames_per_second: float) -> dict[str, Any]:
    """Return a scene as the plain values of truth.json."""
    ids = [thing.object_id for thing in scene.objects]
    return {
        "objects": [
            {
                "object_id": thing.object_id,
                "shape": thing.category,
                "size_m": list(thing.size_m),
                "world_T_object": [
                    thing.motion.pose(frame / frames_per_second).tolist() for frame in range(frames)
                ],
            }
            for thing in scene.objects
        ],
        "containments": [
            {
                "inner": ids[entry.inner],
                "outer": ids[entry.outer],
                "first_frame": math.ceil(entry.start_s * frames_per_second),
                "last_frame": None
                if entry.end_s == math.inf
                else math.floor(entry.end_s * frames_per_second),
            }
            for entry in scene.containments
        ],
    }


def read_scene(path: Path, frames_per_second: float, frames: int) -> Scene:
    """Return the objects of a truth.json.

    Args:
        path: of the file.
        frames_per_second: of the clip.
        frames: of the clip; every object needs as many poses.

    Raises:
        DatasetError: the file is broken: what is wrong, and where.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        objects = tuple(_object(entry, frames_per_second, frames) for entry in values["objects"])
        ids = [thing.object_id for thing in objects]
        containments = tuple(
            _containment(entry, ids, frames_per_second) for entry in values.get("containments", [])
        )
    except KeyError as error:
        raise DatasetError(f"{path}: {error} is missing") from error
    except (OSError, UnicodeDecodeError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: {error}") from error
    if len(set(ids)) < len(ids):
        raise DatasetError(f"{path}: an object_id is there twice")
    return Scene(objects, (), containments=containments)


def _object(entry: dict[str, Any], frames_per_second: float, frames: int) -> SceneObject:
    name, shape = str(entry["object_id"]), entry["shape"]
    if shape not in SHAPES:
        raise ValueError(f"object {name!r} has shape {shape!r}; there are {', '.join(SHAPES)}")
    length, width, height = (float(value) for value in entry["size_m"])
    if not all(0 < side < math.inf for side in (length, width, height)):
        raise ValueError(f"object {name!r} has a size that is not above 0")
    poses = _poses(entry, name, frames)
    return SceneObject(
        object_id=name,
        category=shape,
        size_m=(length, width, height),
        parts=(Part(shape, (length / 2, width / 2, height / 2), _PLAIN),),
        motion=Recorded(
            tuple(tuple(map(tuple, pose)) for pose in poses.tolist()), frames_per_second
        ),
        yaw_observable=shape == "box",
    )


def _poses(entry: dict[str, Any], name: str, frames: int) -> FloatArray:
    """Return an object's (N, 4, 4) poses; raises ValueError."""
    poses = np.asarray(entry["world_T_object"], dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
        raise ValueError(f"object {name!r}: world_T_object needs 4 rows of 4 for every frame")
    if len(poses) < frames:
        raise ValueError(
            f"object {name!r} has {len(poses)} poses; the clip's frames go to {frames - 1}"
        )
    turned = poses[:, :3, :3]
    rigid = np.allclose(turned @ np.swapaxes(turned, 1, 2), np.eye(3), atol=1e-3)
    if not rigid or not np.isfinite(poses).all() or (np.linalg.det(turned) < 0).any():
        raise ValueError(f"object {name!r}: a world_T_object is no rigid pose")
    return poses


def _containment(entry: dict[str, Any], ids: list[str], frames_per_second: float) -> Containment:
    for name in (entry["inner"], entry["outer"]):
        if name not in ids:
            raise ValueError(f"a containment names {name!r}, which is no object")
    last = entry["last_frame"]
    return Containment(
        inner=ids.index(entry["inner"]),
        outer=ids.index(entry["outer"]),
        # A little wider than the frames, so that rounding does not cut one off.
        start_s=(float(entry["first_frame"]) - 0.01) / frames_per_second,
        end_s=math.inf if last is None else (float(last) + 0.01) / frames_per_second,
    )
