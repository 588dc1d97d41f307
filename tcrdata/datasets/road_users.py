"""The road, how things move along it, and what cars, cyclists and pedestrians are made of.

Road coordinates are metres along the road's centre line and to its left; the line is an arc that
leaves the world's origin along x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcrdata.datasets.scene import Part, SceneObject, Still
from tcrdata.datasets.textures import Material
from tcrdata.geometry.intersections import relief
from tcrdata.geometry.raycasting import Shape
from tcrdata.geometry.transforms import as_tuples
from tcrdata.types import FloatArray

# Wavelength, unused, and amplitude of the ground, metres.
RELIEF = (37.0, 0.0, 0.03)
PAINTS = (
    (0.62, 0.05, 0.05), (0.05, 0.13, 0.42), (0.70, 0.70, 0.72), (0.09, 0.09, 0.10),
    (0.33, 0.35, 0.38), (0.06, 0.26, 0.13), (0.75, 0.46, 0.06), (0.30, 0.42, 0.55),
)  # fmt: skip
GLASS = Material((0.05, 0.06, 0.08), 0.2, 2.0, 0.5)
TYRE = Material((0.03, 0.03, 0.03), 0.2, 4.0)
METAL = Material((0.30, 0.31, 0.32), 0.3, 3.0, 0.2)
SKIN = Material((0.62, 0.38, 0.27), 0.2, 5.0)


@dataclass(frozen=True)
class Road:
    """An arc through the world's origin.

    Attributes:
        curvature_per_m: positive bends to the left.
    """

    curvature_per_m: float

    def pose(self, along_m: float, left_m: float, turn_rad: float = 0.0) -> FloatArray:
        """Return the (4, 4) pose on the ground, x along the road (turned by a yaw), z up."""
        bend = along_m * self.curvature_per_m
        x = along_m * float(np.sinc(bend / math.pi)) - left_m * math.sin(bend)
        y = along_m * math.sin(0.5 * bend) * float(np.sinc(0.5 * bend / math.pi))
        y += left_m * math.cos(bend)
        c, s = math.cos(bend + turn_rad), math.sin(bend + turn_rad)
        height = relief(x, y, RELIEF[0], RELIEF[2])
        return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, height], [0, 0, 0, 1]])


@dataclass(frozen=True)
class RoadMotion:
    """Follows the road, or a street that crosses it, at a constant speed.

    Attributes:
        road: the road.
        along_m: place at time 0, or where it crosses.
        left_m: lane, or the place across the road at time 0.
        height_m: of the object's centre above the ground.
        speed_mps: along the road's direction, or to the left when crossing.
        crossing: whether it crosses.
    """

    road: Road
    along_m: float
    left_m: float
    height_m: float
    speed_mps: float
    crossing: bool = False

    def pose(self, time_s: float) -> FloatArray:
        """Return `world_T_object` (4, 4); x points to where it goes."""
        travel = self.speed_mps * time_s
        if self.crossing:
            turn = math.copysign(0.5 * math.pi, self.speed_mps)
            pose = self.road.pose(self.along_m, self.left_m + travel, turn)
        else:
            turn = 0.0 if self.speed_mps >= 0 else math.pi
            pose = self.road.pose(self.along_m + travel, self.left_m, turn)
        pose[2, 3] += self.height_m
        return pose


def make_car(
    random: np.random.Generator,
    name: str,
    motion: RoadMotion | None,
    ground_pose: FloatArray | None = None,
) -> SceneObject:
    """Return a car: body, glass cabin with a roof, four wheels; parked when it has no motion.

    Args:
        random: draws its size and paint.
        name: its object_id.
        motion: with the height of the ground alone; None for a parked car.
        ground_pose: (4, 4) pose on the ground of a parked car.
    """
    length, width = float(random.uniform(3.7, 4.6)), float(random.uniform(1.62, 1.85))
    height = float(random.uniform(1.38, 1.62))
    paint = Material(PAINTS[int(random.integers(len(PAINTS)))], 0.2, 1.5, 0.35)
    sill, belt, roof = 0.22, 0.56 * height, height - 0.07
    shift = -0.06 * length
    half = 0.27 * length
    parts = [
        # The wheels stand out a little, or their sides would lie in the body's.
        _block((0.0, 0.0, sill), (length, width - 0.03, belt), paint, height),
        _block((shift, 0.0, belt), (2 * half, 0.88 * width, roof), GLASS, height),
        _block((shift, 0.0, roof), (1.84 * half, 0.86 * width, height), paint, height),
    ]
    for x in (-0.31 * length, 0.31 * length):
        for y in (-0.5 * width + 0.11, 0.5 * width - 0.11):
            parts.append(_wheel(x, y, 0.31, 0.11, height))
    size = (length, width, height)
    return _standing(name, "Car", size, parts, motion, ground_pose)


def make_cyclist(random: np.random.Generator, name: str, motion: RoadMotion) -> SceneObject:
    """Return a rider on a bicycle."""
    height = float(random.uniform(1.68, 1.8))
    shirt = Material(PAINTS[int(random.integers(len(PAINTS)))], 0.3, 5.0)
    parts = [
        _upright("sphere", (0.1, 0.0, height - 0.12), (0.11, 0.11, 0.12), SKIN, height),
        _upright("sphere", (0.0, 0.0, height - 0.52), (0.20, 0.22, 0.33), shirt, height),
        _upright("sphere", (-0.02, 0.0, 0.75), (0.17, 0.19, 0.42), TYRE, height),
        _block((0.0, 0.0, 0.52), (1.0, 0.05, 0.60), METAL, height),
        _block((0.48, 0.0, 0.95), (0.05, 0.56, 1.0), METAL, height),
    ]
    for x in (-0.55, 0.55):
        parts.append(_wheel(x, 0.0, 0.34, 0.03, height))
    return _standing(name, "Cyclist", (1.78, 0.56, height), parts, motion)


def make_pedestrian(random: np.random.Generator, name: str, motion: RoadMotion) -> SceneObject:
    """Return a walker; the legs do not swing."""
    height = float(random.uniform(1.6, 1.85))
    shirt = Material(PAINTS[int(random.integers(len(PAINTS)))], 0.3, 5.0)
    parts = (
        _upright("sphere", (0.0, 0.0, height - 0.13), (0.11, 0.1, 0.13), SKIN, height),
        _upright("sphere", (0.0, 0.0, height - 0.55), (0.18, 0.26, 0.36), shirt, height),
        _upright("cylinder", (0.18, 0.1, 0.45), (0.08, 0.08, 0.45), TYRE, height),
        _upright("cylinder", (-0.18, -0.1, 0.45), (0.08, 0.08, 0.45), TYRE, height),
    )
    return _standing(name, "Pedestrian", (0.52, 0.52, height), parts, motion)


def _standing(
    name: str,
    category: str,
    size: tuple[float, float, float],
    parts: Sequence[Part],
    motion: RoadMotion | None,
    ground_pose: FloatArray | None = None,
) -> SceneObject:
    """Put an object's centre half its height above the ground it stands on."""
    lift = 0.5 * size[2]
    if motion is not None:
        raised = replace(motion, height_m=motion.height_m + lift)
        return SceneObject(name, category, size, tuple(parts), raised, True)
    pose = np.array(ground_pose)
    pose[2, 3] += lift
    return SceneObject(name, category, size, tuple(parts), Still(as_tuples(pose)), True)


def _wheel(x: float, y: float, radius: float, half_width: float, height: float) -> Part:
    """A cylinder on the ground whose axis points to the left, in the frame of its object."""
    pose = np.array(
        [[1, 0, 0, x], [0, 0, -1, y], [0, 1, 0, radius - 0.5 * height], [0, 0, 0, 1]], dtype=float
    )
    return Part("cylinder", (radius, radius, half_width), TYRE, as_tuples(pose))


def _block(
    foot: tuple[float, float, float],
    extent: tuple[float, float, float],
    material: Material,
    height: float,
) -> Part:
    """A box from the middle of its floor to (length, width, height of its top), above ground."""
    low, top = foot[2], extent[2]
    half = (0.5 * extent[0], 0.5 * extent[1], 0.5 * (top - low))
    return _upright("box", (foot[0], foot[1], 0.5 * (low + top)), half, material, height)


def _upright(
    shape: Shape,
    centre: tuple[float, float, float],
    half_size: tuple[float, float, float],
    material: Material,
    height: float,
) -> Part:
    """A part that is not turned; its centre is given above the ground."""
    pose = np.eye(4)
    pose[:3, 3] = centre[0], centre[1], centre[2] - 0.5 * height
    return Part(shape, half_size, material, as_tuples(pose))
