"""Cameras in a world whose z points up: aimed at a place, and their level frames."""

from __future__ import annotations

import numpy as np

from tcrdata.datasets.scene import View
from tcrdata.geometry.transforms import inverse
from tcrdata.types import Camera, FloatArray

_STEEP_SINE = 0.999


def looking_at(position: FloatArray, target: FloatArray) -> FloatArray:
    """Return `world_T_camera` (4, 4) of a camera that looks at a place, its x axis level.

    Args:
        position: (3,) of the camera, world (m); not above or below the target.
        target: (3,) world (m).
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


def level_view(camera: Camera, world_T_camera: FloatArray) -> View:
    """Return a camera with its level frame: the same origin, y down, z where it looks.

    A camera that looks straight down takes the top of its image for forward.
    """
    rotation = world_T_camera[:3, :3]
    steep = abs(rotation[2, 2]) > _STEEP_SINE
    forward = (-rotation[:, 1] if steep else rotation[:, 2]) * [1.0, 1.0, 0.0]
    forward /= np.linalg.norm(forward)
    down = np.array([0.0, 0.0, -1.0])
    world_T_level = np.eye(4)
    world_T_level[:3, :3] = np.stack([np.cross(down, forward), down, forward], axis=1)
    world_T_level[:3, 3] = world_T_camera[:3, 3]
    level_T_world = inverse(world_T_level)
    return View(camera, inverse(world_T_camera) @ world_T_level, level_T_world)
