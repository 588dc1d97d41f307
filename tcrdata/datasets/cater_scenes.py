"""Scripts clips like CATER's: 5 to 10 objects that slide, are carried, rotate, or cover another.

Sizes, places, colours and motions follow Girdhar and Ramanan, "CATER: a diagnostic dataset for
compositional actions and temporal reasoning" (2020). The hard setting has more objects on less
room, some of them touching.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tcrdata.datasets.cater_stage import FRAMES_PER_SECOND, Actor, Setting, Stage
from tcrdata.datasets.scene import Containment, Part, Scene, SceneObject
from tcrdata.datasets.tabletop_scripts import Move, Script
from tcrdata.datasets.textures import Material
from tcrdata.geometry.raycasting import Shape

SLOT_FRAMES = 25
LIFT_M = 2.0
TRIES = 200
GOALS = 15
SNITCH_HALF_M = 0.3
HALF_SIZES_M = (0.25, 0.5, 0.75)
CONE_HALF_SIZES_M = (0.5, 0.75)
SHAPES: tuple[Shape, ...] = ("box", "sphere", "cylinder", "cone")
GOLD = (0.80, 0.56, 0.10)
COLOURS: dict[str, tuple[float, float, float]] = {
    "gray": (0.25, 0.25, 0.25),
    "red": (0.62, 0.05, 0.05),
    "blue": (0.04, 0.12, 0.62),
    "green": (0.02, 0.34, 0.05),
    "brown": (0.28, 0.12, 0.03),
    "purple": (0.30, 0.05, 0.48),
    "cyan": (0.03, 0.50, 0.52),
    "yellow": (0.82, 0.72, 0.03),
}
GROUND = Material((0.42, 0.41, 0.40), 0.25, 1.6, 0.0)
PLANKS = Material((0.60, 0.43, 0.28), 0.25, 1.6, 0.03, "planks")


EASY = Setting(5, 10, 3.0, 0.25, 0.1, 0.0, 0.4, 0.6, 0.9)
HARD = Setting(16, 22, 2.2, 0.1, 0.02, 0.5, 0.8, 0.6, 0.9)


def build_clip(seed: int, number: int, frames: int, hard: bool) -> Scene:
    """Return the scene of clip `number`."""
    setting = HARD if hard else EASY
    random = np.random.default_rng([seed, number, int(hard)])
    stage = Stage(random, setting, frames)
    _put_down(stage)
    for first in range(0, frames, SLOT_FRAMES):
        _play(stage, first)
    return Scene(
        objects=tuple(_as_object(actor) for actor in stage.actors),
        background=(Part("plane", (0.0, 0.0, 0.0), PLANKS if hard else GROUND),),
        seed=int(random.integers(1, 10_000)),
        containments=tuple(stage.containments),
    )


def _put_down(stage: Stage) -> None:
    """Draw the objects: the golden ball, a cone or two, then anything."""
    random, setting = stage.random, stage.setting
    count = int(random.integers(setting.fewest, setting.most + 1))
    cones = int(random.integers(1, 3))
    for number in range(count):
        for _ in range(TRIES):
            actor = _draw_actor(stage, number, cone=1 <= number <= cones)
            beside = stage.actors and random.random() < setting.touching_share
            if beside:
                actor.script = _beside(stage, actor.script)
            if stage.add(actor, 0.0 if beside else setting.gap_m):
                break


def _draw_actor(stage: Stage, number: int, *, cone: bool) -> Actor:
    random, reach = stage.random, stage.setting.reach_m
    shape: Shape = "cone" if cone else SHAPES[int(random.integers(len(SHAPES)))]
    half = float(random.choice(CONE_HALF_SIZES_M if cone else HALF_SIZES_M))
    colour = str(random.choice(sorted(COLOURS)))
    gloss = float(random.choice([0.05, 0.45]))
    rgb = COLOURS[colour]
    if number == 0:
        shape, half, colour, rgb, gloss = "sphere", SNITCH_HALF_M, "gold", GOLD, 0.45
    x, y = random.uniform(-reach, reach, 2)
    script = Script(shape, (half,) * 3, (float(x), float(y)), float(random.uniform(0, 2 * math.pi)))
    return Actor(f"{number:02d}_{colour}_{shape}", script, Material(rgb, 0.35, 2.2, gloss))


def _beside(stage: Stage, script: Script) -> Script:
    """Return the script of an object moved beside an earlier one, so that they nearly touch."""
    random = stage.random
    other = stage.actors[int(random.integers(len(stage.actors)))].script
    angle = float(random.uniform(0, 2 * math.pi))
    if "box" in (other.shape, script.shape):
        # Side to side: along an axis that both share.
        angle = other.yaw_rad + 0.5 * math.pi * int(random.integers(4))
    apart = other.half_size_m[0] + script.half_size_m[0] + float(random.uniform(0.005, 0.03))
    x = other.start_m[0] + apart * math.cos(angle)
    y = other.start_m[1] + apart * math.sin(angle)
    limit = stage.setting.reach_m
    x, y = (float(np.clip(v, -limit, limit)) for v in (x, y))
    return replace(script, start_m=(x, y), yaw_rad=other.yaw_rad)


def _play(stage: Stage, first: int) -> None:
    """Script one slot: cones that cover something first, then everything that may move."""
    order = [int(n) for n in stage.random.permutation(len(stage.actors))]
    for number in order:
        actor = stage.actors[number]
        idle = actor.holds is None and actor.inside is None and actor.free_s <= _seconds(first + 10)
        if (
            actor.script.shape == "cone"
            and idle
            and stage.random.random() < stage.setting.covering_share
        ):
            _cover(stage, number, first)
    for number in order:
        actor = stage.actors[number]
        if actor.inside is not None or actor.free_s > _seconds(first + 10):
            continue
        setting = stage.setting
        share = setting.moving_share if actor.holds is None else setting.carrying_share
        if stage.random.random() < share:
            _move(stage, number, first)


def _cover(stage: Stage, number: int, first: int) -> None:
    """Carry a cone over the nearest object that fits under it and stands still meanwhile."""
    cone = stage.actors[number]
    start_s, end_s = _span(stage, cone, first)
    for other in stage.random.permutation(len(stage.actors)):
        inner = stage.actors[int(other)]
        if inner.free_s > start_s or inner.inside is not None or inner.holds is not None:
            continue
        if int(other) == number or not fits_under(inner.script, cone.script):
            continue
        place = inner.script.pose(start_s)[:2, 3]
        move = Move(start_s, end_s, (float(place[0]), float(place[1])), LIFT_M)
        if stage.try_move(number, move, ignored=(int(other),)):
            cone.holds, inner.inside, inner.free_s = int(other), number, end_s
            stage.containments.append(Containment(int(other), number, end_s, math.inf))
            return


def _move(stage: Stage, number: int, first: int) -> None:
    """Slide, carry or rotate an object. What a cone holds slides along; it is left when lifted."""
    actor = stage.actors[number]
    start_s, end_s = _span(stage, actor, first)
    kinds = ["slide", "carry"]
    if actor.holds is not None:
        kinds.append("slide")
    elif actor.script.shape in ("box", "cylinder"):
        kinds.append("rotate")
    kind = str(stage.random.choice(kinds))
    for move in _draw_moves(stage, actor, kind, start_s, end_s):
        if stage.try_move(number, move):
            return


def _draw_moves(
    stage: Stage, actor: Actor, kind: str, start_s: float, end_s: float
) -> Iterator[Move]:
    """Yield moves of a kind, another goal each."""
    random, reach = stage.random, stage.setting.reach_m
    place = actor.script.pose(start_s)[:2, 3]
    for _ in range(GOALS):
        if kind == "rotate":
            axis = actor.script.yaw_rad + 0.5 * math.pi * int(random.integers(4))
            target = (float(place[0]), float(place[1]))
            yield Move(start_s, end_s, target, 0.0, 0.5 * math.pi, axis)
        else:
            x, y = (float(v) for v in random.uniform(-reach, reach, 2))
            if math.hypot(x - place[0], y - place[1]) > 0.8:
                yield Move(start_s, end_s, (x, y), LIFT_M if kind == "carry" else 0.0)


def _span(stage: Stage, actor: Actor, first: int) -> tuple[float, float]:
    """Draw when a motion begins and ends, in seconds."""
    start_s = max(_seconds(first + int(stage.random.integers(0, 11))), actor.free_s)
    return start_s, start_s + _seconds(int(stage.random.integers(20, 31)))


def fits_under(inner: Script, cone: Script) -> bool:
    """Tell whether an object that stands upright is hidden whole inside a cone put over it."""
    a, _, c = inner.half_size_m
    radius, height = cone.half_size_m[0], 2 * cone.half_size_m[2]
    if inner.shape == "sphere":
        # The cone's wall must keep outside of the ball.
        slope = radius / height
        return a * math.sqrt(1 + slope * slope) <= radius - slope * a
    if inner.shape == "cone":
        return a < radius
    wide = a * math.sqrt(2.0) if inner.shape == "box" else a
    return wide <= radius * (1 - 2 * c / height)


def _seconds(frame: int) -> float:
    return frame / FRAMES_PER_SECOND


def _as_object(actor: Actor) -> SceneObject:
    a, b, c = actor.script.half_size_m
    return SceneObject(
        object_id=actor.name,
        category=actor.script.shape,
        size_m=(2 * a, 2 * b, 2 * c),
        parts=(Part(actor.script.shape, actor.script.half_size_m, actor.material),),
        motion=actor.script,
        yaw_observable=actor.script.shape == "box",
    )
