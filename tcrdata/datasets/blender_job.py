"""What Blender is asked to render: a clip's things, where they are, cameras and lamps, as JSON.

A job has `width_px`, `height_px`, `samples`, `denoise`, `threads`, `seed`, `part_path` (where an
image is written before it is moved; {} is the process's id), `ambient` (linear RGB from all
around), `lights` (`place_m`, `target_m`, `watts`, `size_m`), `things` (`shape`, `half_size_m`,
linear `colour`, `look`: rubber, metal or ground), `poses` (by frame, `world_T_thing` of each),
`cameras` (`intrinsics_px`, `world_T_camera`) and `images` (`kind` rgb or geometry, `camera`,
`frame`, `path`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tcrdata.datasets.cater_clips import camera_json
from tcrdata.datasets.cater_generator import GeneratedClips
from tcrdata.datasets.scene import Part

GROUND_HALF_M = 60.0
GROUND_COLOUR = (0.3, 0.3, 0.3)
AMBIENT = (0.18, 0.18, 0.18)
METAL_GLOSS = 0.25
LAMP_JITTER_M = 1.0


@dataclass(frozen=True)
class Lamp:
    """A square lamp that shines at the middle of the table.

    Attributes:
        place_m: (3,) world.
        watts: its power.
        size_m: its side: how soft its shadows are.
    """

    place_m: tuple[float, float, float]
    watts: float
    size_m: float


KEY = Lamp((8.0, -3.6, 8.0), 950.0, 1.0)
FILL = Lamp((-7.0, -6.0, 7.0), 330.0, 3.0)
BACK = Lamp((-1.8, 6.9, 8.5), 600.0, 1.5)


@dataclass(frozen=True)
class Wanted:
    """An image to render.

    Attributes:
        camera: of the clip.
        frame: of the clip.
        path: the file that it becomes.
        kind: `rgb`, or `geometry`: depth and the number of the thing that each pixel sees.
    """

    camera: int
    frame: int
    path: Path
    kind: Literal["rgb", "geometry"] = "rgb"


def scene_job(clips: GeneratedClips, clip: str, wanted: Sequence[Wanted]) -> dict[str, Any]:
    """Return the part of a job that a clip decides: everything but how it is rendered."""
    scene, rate = clips.scene(clip), clips.frames_per_second(clip)
    first = clips.view(clip, 0).camera
    frames = sorted({image.frame for image in wanted})
    return {
        "width_px": first.width_px,
        "height_px": first.height_px,
        "seed": scene.seed,
        "ambient": AMBIENT,
        "lights": _lights(scene.seed),
        "things": [_thing(part) for part in scene.parts()],
        "poses": {
            str(frame): [pose.tolist() for pose in scene.poses(frame / rate)] for frame in frames
        },
        "cameras": [camera_json(clips.view(clip, n)) for n in range(clips.cameras(clip))],
        "images": [
            {
                "kind": image.kind,
                "camera": image.camera,
                "frame": image.frame,
                "path": str(image.path.absolute()),
            }
            for image in wanted
        ],
    }


def _lights(seed: int) -> list[dict[str, Any]]:
    """Return the lamps, each a little shifted from clip to clip."""
    shifts = np.random.default_rng([seed, 78]).uniform(-LAMP_JITTER_M, LAMP_JITTER_M, (3, 3))
    return [
        {
            "place_m": (np.asarray(lamp.place_m) + shift).tolist(),
            "target_m": [0.0, 0.0, 0.0],
            "watts": lamp.watts,
            "size_m": lamp.size_m,
        }
        for lamp, shift in zip((KEY, FILL, BACK), shifts, strict=True)
    ]


def _thing(part: Part) -> dict[str, Any]:
    """Return a shape and its look: what is glossy is metal, everything else rubber."""
    if part.shape == "plane":
        half_size_m = (GROUND_HALF_M, GROUND_HALF_M, 1.0)
        return {
            "shape": "plane",
            "half_size_m": half_size_m,
            "colour": GROUND_COLOUR,
            "look": "ground",
        }
    return {
        "shape": part.shape,
        "half_size_m": part.half_size_m,
        "colour": part.material.colour,
        "look": "metal" if part.material.gloss > METAL_GLOSS else "rubber",
    }
