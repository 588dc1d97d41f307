"""Scripts the street: a gently bent road between houses, with parked and moving road users.

Places are in road coordinates, see `road_users`. Traffic keeps to the right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tcrdata.datasets.road_users import (
    METAL,
    RELIEF,
    Road,
    RoadMotion,
    make_car,
    make_cyclist,
    make_pedestrian,
)
from tcrdata.datasets.scene import Part, Scene, SceneObject
from tcrdata.datasets.shading import Light
from tcrdata.datasets.textures import Material
from tcrdata.geometry.raycasting import Shape
from tcrdata.geometry.transforms import as_tuples
from tcrdata.types import FloatArray

FRAMES_PER_SECOND = 10
LANE_M, CYCLING_M, PARKING_M, KERB_M, WALKING_M, HOUSE_M = 1.75, 3.15, 4.6, 5.6, 7.4, 9.5
KERB_HEIGHT_M = 0.12
SIGHT_M = 110.0
PARKING_STEP_M = 6.5
JUNCTION_AHEAD_M = 45.0
JUNCTION_HALF_M = 9.0
SUN = Light(
    direction=(-0.45, 0.55, 0.9),
    spread=0.0,
    strength=0.95,
    ambient=0.42,
    horizon=(0.74, 0.83, 0.92),
    zenith=(0.24, 0.45, 0.80),
    haze_m=160.0,
    shadow_rays=1,
    closeness=False,
)
WALLS = (
    (0.55, 0.45, 0.34), (0.62, 0.56, 0.46), (0.45, 0.24, 0.17), (0.50, 0.50, 0.48),
    (0.60, 0.40, 0.28), (0.40, 0.43, 0.46),
)  # fmt: skip
PAVEMENT = Material((0.36, 0.35, 0.33), 0.3, 2.5)
BARK = Material((0.20, 0.13, 0.08), 0.4, 4.0)


@dataclass(frozen=True)
class Plan:
    """What the drive is made of.

    Attributes:
        seed: of everything that is drawn.
        duration_s: of the drive.
        speed_mps: of the own car.
        parked: number of parked cars.
        moving: number of moving road users.
    """

    seed: int
    duration_s: float
    speed_mps: float
    parked: int
    moving: int


@dataclass(frozen=True)
class Street:
    """The scene and the road that the own car follows in its right lane.

    Attributes:
        scene: objects and background.
        road: the road.
    """

    scene: Scene
    road: Road


def build_street(plan: Plan) -> Street:
    """Return the scripted street of a plan."""
    random = np.random.default_rng([plan.seed, 7])
    bend = float(random.choice([-1.0, 1.0]) / random.uniform(150.0, 400.0))
    road = Road(bend)
    middle_s = float(random.uniform(0.3, 0.6)) * plan.duration_s
    junction_m = plan.speed_mps * middle_s + JUNCTION_AHEAD_M
    movers = list(_movers(random, road, plan, middle_s, junction_m))
    parked = list(_parked(random, road, plan, junction_m))
    end_m = plan.speed_mps * plan.duration_s + SIGHT_M
    asphalt = Material((0.13, 0.13, 0.135), 0.25, 2.0, 0.0, "road", (bend, 3.85))
    ground = Part("plane", RELIEF, asphalt)
    background = list(_pavements(road, end_m, junction_m))
    background += _houses(random, road, end_m, junction_m)
    background += _greenery(random, road, end_m, junction_m)
    # Last, because most rays have met something nearer by then.
    background.append(ground)
    return Street(Scene(tuple(movers + parked), tuple(background), seed=plan.seed), road)


def _movers(
    random: np.random.Generator, road: Road, plan: Plan, middle_s: float, junction_m: float
) -> Iterator[SceneObject]:
    speed, duration = plan.speed_mps, plan.duration_s
    for number in range(plan.moving):
        name, kind = f"moving_{number:02d}", number % 5
        if kind == 0:
            # Meets the own car inside the clip, each further one 14 m behind the last.
            own = -float(random.uniform(6.0, 11.0)) if number == 0 else -8.0
            meet = 0.6 * duration
            along = (speed - own) * meet + 12.0 + 14.0 * number
            yield make_car(random, name, RoadMotion(road, along, LANE_M, 0.0, own))
        elif kind == 1:
            own = speed + min(1.0, 6.0 / duration)
            along = float(random.uniform(14.0, 20.0)) + 4.0 * (number - 1)
            yield make_car(random, name, RoadMotion(road, along, -LANE_M, 0.0, own))
        elif kind == 2:
            along, own = float(random.uniform(9.0, 25.0)), float(random.uniform(3.5, 5.5))
            motion = RoadMotion(road, along + 7.0 * (number - 2), -CYCLING_M, 0.0, own)
            yield make_cyclist(random, name, motion)
        elif kind == 3:
            side = float(random.choice([-1.0, 1.0]))
            along, own = float(random.uniform(10.0, 30.0)), float(random.uniform(1.0, 1.7))
            motion = RoadMotion(road, along, side * WALKING_M, KERB_HEIGHT_M, side * own)
            yield make_pedestrian(random, name, motion)
        else:
            own = float(random.choice([-1.0, 1.0]) * random.uniform(5.0, 8.0))
            across = -own * middle_s - math.copysign(6.0 * (number - 4), own)
            motion = RoadMotion(road, junction_m, across, 0.0, own, crossing=True)
            yield make_car(random, name, motion)


def _parked(
    random: np.random.Generator, road: Road, plan: Plan, junction_m: float
) -> Iterator[SceneObject]:
    reach = plan.speed_mps * plan.duration_s + 45.0
    slots = max(math.ceil(reach / PARKING_STEP_M), plan.parked)
    free = [
        (side, 4.0 + PARKING_STEP_M * slot)
        for slot in range(slots)
        for side in (-1.0, 1.0)
        if abs(4.0 + PARKING_STEP_M * slot - junction_m) > JUNCTION_HALF_M
    ]
    chosen = random.permutation(len(free))[: plan.parked]
    for number, (side, along) in enumerate(free[index] for index in sorted(chosen)):
        along += float(random.uniform(-0.6, 0.6))
        left = side * (PARKING_M + float(random.uniform(-0.12, 0.12)))
        turn = (0.0 if side < 0 else math.pi) + float(random.normal(0.0, 0.02))
        yield make_car(random, f"parked_{number:02d}", None, road.pose(along, left, turn))


def _pavements(road: Road, end_m: float, junction_m: float) -> Iterator[Part]:
    step, width = 6.0, 3.4
    for along in np.arange(-SIGHT_M, end_m, step):
        if abs(along + 0.5 * step - junction_m) < JUNCTION_HALF_M:
            continue
        for side in (-1.0, 1.0):
            pose = road.pose(along + 0.5 * step, side * (KERB_M + 0.5 * width))
            # Sunk deep enough to have no gap below it; the outer edge of a bend is the longer.
            half = (0.5 * step * 1.04, 0.5 * width, 0.3)
            pose[2, 3] += KERB_HEIGHT_M - half[2]
            yield Part("box", half, PAVEMENT, as_tuples(pose))


def _houses(
    random: np.random.Generator, road: Road, end_m: float, junction_m: float
) -> Iterator[Part]:
    for side in (-1.0, 1.0):
        along = -SIGHT_M
        while along < end_m:
            length, depth = float(random.uniform(9.0, 18.0)), float(random.uniform(7.0, 11.0))
            height, back = float(random.uniform(5.0, 12.0)), float(random.uniform(0.0, 3.0))
            middle = along + 0.5 * length
            along += length + float(random.choice([0.0, 1.5, 4.0]))
            if abs(middle - junction_m) < JUNCTION_HALF_M + 0.5 * length:
                continue
            wall = Material(WALLS[int(random.integers(len(WALLS)))], 0.3, 1.2, 0.0, "windows")
            pose = road.pose(middle, side * (HOUSE_M + back + 0.5 * depth))
            pose[2, 3] += 0.5 * height
            half = (0.5 * length, 0.5 * depth, 0.5 * height)
            yield Part("box", half, wall, as_tuples(pose))
            front = road.pose(middle, side * (HOUSE_M + back))
            yield from _facade(random, front, length, height)


def _facade(
    random: np.random.Generator, front: FloatArray, length: float, height: float
) -> Iterator[Part]:
    """Bays, porches and downpipes: without them a wall looks the same all along the road."""
    along = -0.5 * length + float(random.uniform(0.5, 2.0))
    while along < 0.5 * length - 0.8:
        half = (
            float(random.uniform(0.15, 0.9)),
            float(random.uniform(0.15, 0.7)),
            float(random.uniform(0.4, 0.5 * height)),
        )
        pose = front.copy()
        pose[:3, 3] += front[:3, 0] * along + front[:3, 2] * half[2]
        trim = Material(WALLS[int(random.integers(len(WALLS)))], 0.3, 1.5)
        yield Part("box", half, trim, as_tuples(pose))
        along += 2.0 * half[0] + float(random.uniform(0.8, 3.0))


def _greenery(
    random: np.random.Generator, road: Road, end_m: float, junction_m: float
) -> Iterator[Part]:
    """Trees, lamp posts and bins along both kerbs."""
    for side in (-1.0, 1.0):
        along = -SIGHT_M + float(random.uniform(0.0, 10.0))
        while along < end_m:
            left, kind = side * (KERB_M + float(random.uniform(0.45, 0.8))), int(random.integers(4))
            if abs(along - junction_m) > JUNCTION_HALF_M:
                pose = road.pose(along, left)
                if kind < 2:
                    yield from _tree(random, pose)
                elif kind == 2:
                    yield _standing_part("cylinder", (0.09, 0.09, 3.2), METAL, pose)
                else:
                    yield _standing_part("box", (0.3, 0.35, 0.55), METAL, pose)
            along += float(random.uniform(4.0, 9.0))


def _tree(random: np.random.Generator, ground: FloatArray) -> Iterator[Part]:
    trunk, crown = float(random.uniform(2.2, 3.0)), float(random.uniform(1.1, 1.7))
    green = Material((0.09, 0.24 + 0.1 * float(random.random()), 0.06), 0.6, 2.5)
    yield _standing_part("cylinder", (0.16, 0.16, 0.5 * trunk + 0.2), BARK, ground)
    for _ in range(3):
        pose = ground.copy()
        pose[:3, 3] += random.uniform(-0.5, 0.5, 3) * crown + (0.0, 0.0, trunk + 0.7 * crown)
        half = crown * float(random.uniform(0.7, 1.0))
        yield Part("sphere", (half, half, 0.85 * half), green, as_tuples(pose))


def _standing_part(
    shape: Shape, half_size: tuple[float, float, float], material: Material, ground: FloatArray
) -> Part:
    pose = ground.copy()
    pose[2, 3] += half_size[2]
    return Part(shape, half_size, material, as_tuples(pose))
