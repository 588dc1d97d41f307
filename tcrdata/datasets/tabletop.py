"""Scripts the demo's tabletop: objects that slide, tilt, are lifted, hide one another, or stay.

Table coordinates are (right, back) as the camera sees them; half sizes and colours follow CATER
(Girdhar and Ramanan 2020).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from tcrdata.datasets.scene import Part, Scene, SceneObject
from tcrdata.datasets.shading import Light
from tcrdata.datasets.tabletop_scripts import Move, Script, rotation_about
from tcrdata.datasets.textures import Material
from tcrdata.geometry.raycasting import Shape
from tcrdata.types import Camera, FloatArray

FRAMES_PER_SECOND = 24
CAMERA = Camera(
    projection=((350.0, 0.0, 160.0, 0.0), (0.0, 350.0, 120.0, 0.0), (0.0, 0.0, 1.0, 0.0)),
    width_px=320,
    height_px=240,
)
MAX_DEPTH_M = 20.0
CAMERA_POSITION = (7.48, -6.51, 5.34)
ROUND_FRAMES = 48
HALF_SIZES = (0.25, 0.5, 0.75)
REACH_M = 2.6
GAP_M = 0.15
TRIES = 400
LIFT_M = 1.6
COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (0.72, 0.07, 0.06),
    "blue": (0.05, 0.17, 0.62),
    "green": (0.06, 0.36, 0.10),
    "yellow": (0.86, 0.56, 0.05),
    "purple": (0.30, 0.07, 0.45),
    "cyan": (0.05, 0.50, 0.55),
    "orange": (0.83, 0.24, 0.03),
    "white": (0.72, 0.72, 0.70),
}
LAMP = Light(
    direction=(0.30, -0.62, 1.05),
    spread=0.09,
    strength=0.95,
    ambient=0.36,
    horizon=(0.80, 0.86, 0.92),
    zenith=(0.45, 0.62, 0.85),
    haze_m=42.0,
    shadow_rays=12,
)
TABLE = Material((0.60, 0.43, 0.28), 0.25, 1.6, 0.03, "planks")
Role = Literal["blocker", "passer", "shuttle", "tilter", "lifted", "still"]
ROLES: tuple[Role, ...] = (
    "blocker", "passer", "tilter", "shuttle", "lifted", "still", "shuttle", "still",
)  # fmt: skip


def build_scene(seed: int, number: int, frames: int) -> Scene:
    """Return the scene of clip `number`: 6 to 8 objects on a plank table."""
    for attempt in range(TRIES):
        random = np.random.default_rng([seed, number, attempt])
        objects = _draw_objects(random, frames)
        if objects:
            break
    table = Part("plane", (0.0, 0.0, 0.0), TABLE)
    return Scene(tuple(objects), (table,), seed=int(random.integers(1, 10_000)))


def _draw_objects(random: np.random.Generator, frames: int) -> list[SceneObject]:
    """Draw objects one after another; empty when one found no free place."""
    colours = list(random.permutation(sorted(COLOURS)))
    objects: list[SceneObject] = []
    for number in range(int(random.integers(6, len(ROLES) + 1))):
        for _ in range(TRIES):
            script = _draw_script(random, ROLES[number], objects, frames)
            candidate = _as_object(f"{number:02d}", str(colours[number]), script)
            if all(_apart(candidate, other, frames) for other in objects):
                objects.append(candidate)
                break
        else:
            return []
    return objects


def _draw_script(
    random: np.random.Generator, role: Role, objects: list[SceneObject], frames: int
) -> Script:
    shape, half_size = _draw_shape(random, role)
    start, target = _draw_place(random), _draw_place(random)
    if role == "blocker":
        start = _from_table(random.uniform(-0.5, 0.5), random.uniform(-1.3, -0.6))
    elif role == "passer":
        # Behind the blocker, from one of its sides to the other.
        middle = _to_table(objects[0].motion.pose(0.0)[:2, 3])
        side = float(random.choice([-1.0, 1.0]))
        back = middle[1] + 0.9 + half_size[0] + random.uniform(0.2, 0.5)
        start = _from_table(middle[0] + side * random.uniform(1.9, 2.3), back)
        target = _from_table(middle[0] - side * random.uniform(1.5, 2.1), back)
    elif role == "still":
        # What never moves should be seen, at least in part.
        blocker = _to_table(objects[0].motion.pose(0.0)[:2, 3])
        while abs(_aside(start, blocker)) < 0.9 and _behind(start, blocker):
            start = _draw_place(random)
    script = Script(shape, half_size, start, float(random.uniform(-math.pi, math.pi)))
    for first in range(0, frames, ROUND_FRAMES):
        moves = tuple(_draw_moves(random, role, script, first, start, target))
        script = replace(script, moves=script.moves + moves)
        start, target = target, start
    return script


def _draw_shape(
    random: np.random.Generator, role: Role
) -> tuple[Shape, tuple[float, float, float]]:
    shapes: dict[Role, tuple[Shape, ...]] = {
        "blocker": ("box", "cylinder"),
        "passer": ("sphere", "cylinder", "box"),
        "shuttle": ("sphere", "box", "cylinder", "cone"),
        "tilter": ("box", "cylinder"),
        "lifted": ("cone", "box", "sphere"),
        "still": ("cone", "sphere", "cylinder", "box"),
    }
    shape: Shape = shapes[role][int(random.integers(len(shapes[role])))]
    sizes = {"blocker": HALF_SIZES[2:], "still": HALF_SIZES}.get(role, HALF_SIZES[:2])
    half = float(random.choice(sizes))
    if role in ("tilter", "shuttle"):
        half = HALF_SIZES[1]
    if shape == "box":
        return shape, (half, half * float(random.uniform(0.6, 1.0)), half)
    if shape == "cylinder":
        radius = 0.65 * half
        return shape, (radius, radius, half)
    return shape, (half, half, half)


def _draw_moves(
    random: np.random.Generator,
    role: Role,
    script: Script,
    first: int,
    start: tuple[float, float],
    target: tuple[float, float],
) -> Iterator[Move]:
    """Yield the moves of one round of `ROUND_FRAMES` frames, from start to target."""
    begin = first + int(random.integers(0, 11))
    end = begin + int(random.integers(20, 31))
    rate = float(FRAMES_PER_SECOND)
    if role in ("passer", "lifted"):
        yield Move(begin / rate, end / rate, target, LIFT_M if role == "lifted" else 0.0)
    elif role == "shuttle":
        middle = first + int(random.integers(18, 23))
        way = 0.5 * (np.asarray(start) + target) + random.uniform(-0.8, 0.8, 2)
        yield Move((first + 1) / rate, middle / rate, (float(way[0]), float(way[1])))
        yield Move((middle + 6) / rate, (first + 46) / rate, target)
    elif role == "tilter":
        # About one of its own level axes, so that it comes to lie on a face.
        axis = script.yaw_rad + 0.5 * math.pi * int(random.integers(4))
        turn = 0.5 * math.pi
        if first == 0:
            target = start
        yield Move(begin / rate, end / rate, target, 0.0, turn, axis)


def _draw_place(random: np.random.Generator) -> tuple[float, float]:
    return _from_table(random.uniform(-REACH_M, REACH_M), random.uniform(-2.2, REACH_M))


def _aside(place: tuple[float, float], blocker: tuple[float, float]) -> float:
    return _to_table(np.asarray(place))[0] - blocker[0]


def _behind(place: tuple[float, float], blocker: tuple[float, float]) -> bool:
    return 0.0 < _to_table(np.asarray(place))[1] - blocker[1] < 3.0


def _table_axes() -> FloatArray:
    """(2, 2): rows are right and back, in the world's plane."""
    back = -np.asarray(CAMERA_POSITION[:2]) / np.hypot(*CAMERA_POSITION[:2])
    return np.array([[back[1], -back[0]], back])


def _from_table(right: float, back: float) -> tuple[float, float]:
    x, y = np.array([right, back]) @ _table_axes()
    return float(x), float(y)


def _to_table(place: FloatArray) -> tuple[float, float]:
    right, back = _table_axes() @ place
    return float(right), float(back)


def _as_object(number: str, colour: str, script: Script) -> SceneObject:
    material = Material(COLOURS[colour], 0.35, 2.2, 0.18)
    a, b, c = script.half_size_m
    return SceneObject(
        object_id=f"{number}_{colour}_{script.shape}",
        category=script.shape,
        size_m=(2 * a, 2 * b, 2 * c),
        parts=(Part(script.shape, script.half_size_m, material),),
        motion=script,
        yaw_observable=script.shape == "box",
    )


def _apart(one: SceneObject, other: SceneObject, frames: int) -> bool:
    """Tell whether two objects keep clear of one another in the whole clip."""
    reach = 0.5 * (math.hypot(*one.size_m[:2]) + math.hypot(*other.size_m[:2]))
    if "box" not in (one.category, other.category):
        reach /= math.sqrt(2.0)
    tall = 0.5 * (one.size_m[2] + other.size_m[2])
    for frame in range(0, frames, 2):
        time_s = frame / FRAMES_PER_SECOND
        gap = one.motion.pose(time_s)[:3, 3] - other.motion.pose(time_s)[:3, 3]
        if np.hypot(gap[0], gap[1]) < reach + GAP_M and abs(gap[2]) < tall + GAP_M:
            return False
    return True


def camera_axes() -> tuple[FloatArray, FloatArray]:
    """Return `camera_T_level` and `level_T_world` of the demo's camera: it looks at the origin."""
    position = np.asarray(CAMERA_POSITION)
    pitch = math.atan2(position[2], math.hypot(position[0], position[1]))
    level_T_world = np.eye(4)
    level_T_world[:3, :3] = [
        [*_table_axes()[0], 0.0],
        [0.0, 0.0, -1.0],
        [*_table_axes()[1], 0.0],
    ]
    level_T_world[:3, 3] = -level_T_world[:3, :3] @ position
    camera_T_level = np.eye(4)
    camera_T_level[:3, :3] = rotation_about((1.0, 0.0, 0.0), pitch)
    return camera_T_level, level_T_world
