"""A scripted world of rigid objects: where everything is at a time, and the truth about it.

World frame: x and y in the ground's plane, z up, metres. Object frame: the centre of the object's
box, x along its length, y along its width (left), z along its height (up).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tcrdata.datasets.textures import Material, material_rows
from tcrdata.geometry.raycasting import Primitives, Shape, place
from tcrdata.geometry.transforms import as_tuples, inverse, transform_points
from tcrdata.types import Camera, FloatArray

ROUND_STEPS = 64
SPEED_STEP_S = 1e-3
Matrix = tuple[tuple[float, ...], ...]
IDENTITY: Matrix = as_tuples(np.eye(4))


class Motion(Protocol):
    """Where an object is."""

    def pose(self, time_s: float) -> FloatArray:
        """Return `world_T_object` (4, 4)."""
        ...


@dataclass(frozen=True)
class Still:
    """Never moves.

    Attributes:
        world_T_object: (4, 4) as tuples.
    """

    world_T_object: Matrix

    def pose(self, time_s: float) -> FloatArray:  # noqa: ARG002
        """Return the one pose."""
        return np.asarray(self.world_T_object, dtype=np.float64)


@dataclass(frozen=True)
class Part:
    """One shape of an object, or of the background.

    Attributes:
        shape: its kind.
        half_size_m: along its own x, y and z.
        material: its look.
        object_T_part: (4, 4) as tuples.
    """

    shape: Shape
    half_size_m: tuple[float, float, float]
    material: Material
    object_T_part: Matrix = IDENTITY

    def outline(self) -> FloatArray:
        """Return (N, 3) points in the part's frame whose hull holds it, tightly."""
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        angles = np.arange(ROUND_STEPS) * (2 * np.pi / ROUND_STEPS)
        up = np.array([0.0, 0.0, 1.0])
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(ROUND_STEPS)], axis=1)
        if self.shape == "cylinder":
            corners = np.concatenate([ring + up, ring - up])
        elif self.shape == "cone":
            corners = np.concatenate([ring - up, up[None]])
        elif self.shape == "sphere":
            heights = np.linspace(-1, 1, ROUND_STEPS // 2 + 1)
            radii = np.sqrt(1 - heights**2)
            corners = (ring[None] * radii[:, None, None]).reshape(-1, 3)
            corners[:, 2] = np.repeat(heights, ROUND_STEPS)
        outline: FloatArray = corners * np.asarray(self.half_size_m)
        return outline


@dataclass(frozen=True)
class SceneObject:
    """A labelled thing.

    Attributes:
        object_id: its name, unique in the scene.
        category: its class.
        size_m: length, width and height of its box.
        parts: what it is made of.
        motion: where it is.
        yaw_observable: false when it looks alike from all sides.
    """

    object_id: str
    category: str
    size_m: tuple[float, float, float]
    parts: tuple[Part, ...]
    motion: Motion
    yaw_observable: bool

    def outline(self) -> FloatArray:
        """Return (N, 3) points in the object's frame whose hull holds it, tightly."""
        return np.concatenate(
            [transform_points(part.object_T_part, part.outline()) for part in self.parts]
        )

    def speed(self, time_s: float) -> float:
        """Return the speed of the centre in the world (m/s)."""
        later = self.motion.pose(time_s + SPEED_STEP_S)[:3, 3]
        earlier = self.motion.pose(time_s - SPEED_STEP_S)[:3, 3]
        return float(np.linalg.norm(later - earlier) / (2 * SPEED_STEP_S))


@dataclass(frozen=True)
class Containment:
    """An object that is under another for a while and moves with it.

    Attributes:
        inner: number of the object that is covered.
        outer: number of the object that covers it.
        start_s: from when on.
        end_s: until when; infinite when it stays.
    """

    inner: int
    outer: int
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Scene:
    """Objects before a background that does not move.

    Attributes:
        objects: the labelled things.
        background: parts whose `object_T_part` is `world_T_part`.
        seed: of the materials' noise.
        containments: which objects are under which, and when.
    """

    objects: tuple[SceneObject, ...]
    background: tuple[Part, ...]
    seed: int = 0
    containments: tuple[Containment, ...] = ()

    def container(self, number: int, time_s: float) -> SceneObject | None:
        """Return the object that an object is under at a time; None when under none."""
        for entry in self.containments:
            if entry.inner == number and entry.start_s <= time_s <= entry.end_s:
                return self.objects[entry.outer]
        return None

    def parts(self) -> list[Part]:
        """Return every part in the order of the primitives: objects first."""
        return [part for thing in self.objects for part in thing.parts] + list(self.background)

    def owners(self) -> list[int]:
        """Return the object of every part, -1 for the background."""
        owned = [number for number, thing in enumerate(self.objects) for _ in thing.parts]
        return owned + [-1] * len(self.background)

    def poses(self, time_s: float) -> list[FloatArray]:
        """Return `world_T_part` (4, 4) of every part at a time, in the order of `parts`."""
        poses = [
            thing.motion.pose(time_s) @ np.asarray(part.object_T_part)
            for thing in self.objects
            for part in thing.parts
        ]
        return poses + [np.asarray(part.object_T_part) for part in self.background]

    def primitives(self, time_s: float) -> Primitives:
        """Return every shape at a time."""
        parts = self.parts()
        return place(
            [part.shape for part in parts],
            [part.half_size_m for part in parts],
            np.array(self.poses(time_s)),
            self.owners(),
        )

    def materials(self) -> FloatArray:
        """Return the (P, 10) rows of every part's material."""
        parts = self.parts()
        return material_rows(
            [part.material for part in parts], [100 * n + self.seed for n in range(len(parts))]
        )


@dataclass(frozen=True)
class View:
    """A camera at one moment.

    Attributes:
        camera: the pinhole; its projection is [K | 0].
        camera_T_level: (4, 4).
        level_T_world: (4, 4).
    """

    camera: Camera
    camera_T_level: FloatArray
    level_T_world: FloatArray

    @property
    def world_to_camera(self) -> FloatArray:
        """World (m) to camera."""
        return self.camera_T_level @ self.level_T_world

    @property
    def origin(self) -> FloatArray:
        """(3,) the camera's centre in the world."""
        return inverse(self.world_to_camera)[:3, 3]

    @property
    def pixel_rays(self) -> FloatArray:
        """(3, 3): (column, row, 1) to a world direction with forward length 1."""
        rotation = inverse(self.world_to_camera)[:3, :3]
        return rotation @ np.linalg.inv(self.camera.matrix[:, :3])

    def rays(self) -> FloatArray:
        """Return (H * W, 3) world directions through the centres of the pixels, row by row."""
        rows, columns = np.mgrid[0 : self.camera.height_px, 0 : self.camera.width_px]
        pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
        return pixels @ self.pixel_rays.T

    def project(self, world_points: NDArray[np.floating]) -> tuple[FloatArray, FloatArray]:
        """Return (N, 2) pixels and (N,) depths of (N, 3) world points."""
        seen = transform_points(self.world_to_camera, world_points) @ self.camera.matrix[:, :3].T
        depth = seen[:, 2]
        return seen[:, :2] / np.where(depth > 0, depth, np.nan)[:, None], depth
