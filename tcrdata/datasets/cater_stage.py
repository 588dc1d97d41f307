"""The objects of a clip while it is scripted: what stands where, and which moves have room."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tcrdata.datasets.footprints import Footprints, footprints, gap_m, moved
from tcrdata.datasets.scene import Containment
from tcrdata.datasets.tabletop_scripts import Move, Script
from tcrdata.datasets.textures import Material

FRAMES_PER_SECOND = 24


@dataclass(frozen=True)
class Setting:
    """How a clip is drawn.

    Attributes:
        fewest: objects.
        most: objects.
        reach_m: x and y of the objects lie within +- this.
        gap_m: least room between objects at first.
        clearance_m: least room between an object that moves and the others.
        touching_share: objects that are put beside an earlier one.
        moving_share: chance that an object moves in a slot.
        covering_share: chance that a cone covers a smaller object in a slot, if it can.
        carrying_share: chance that a cone that covers something moves in a slot.
    """

    fewest: int
    most: int
    reach_m: float
    gap_m: float
    clearance_m: float
    touching_share: float
    moving_share: float
    covering_share: float
    carrying_share: float


@dataclass
class Actor:
    """An object while its script is written.

    Attributes:
        name: its id.
        script: its moves so far.
        material: its look.
        free_s: when its last move is over.
        inside: number of the cone that it is under.
        holds: number of the object that it covers.
    """

    name: str
    script: Script
    material: Material
    free_s: float = 0.0
    inside: int | None = None
    holds: int | None = None


class Stage:
    """The objects of one clip, and what they do.

    Attributes:
        random: draws everything.
        setting: how the clip is drawn.
        actors: the objects.
        containments: which was put over which.
        times_s: when room is looked for.
    """

    def __init__(self, random: np.random.Generator, setting: Setting, frames: int) -> None:
        self.random = random
        self.setting = setting
        self.actors: list[Actor] = []
        self.containments: list[Containment] = []
        self.times_s = np.arange(frames + 10) / FRAMES_PER_SECOND
        self._footprints: list[Footprints] = []

    def add(self, actor: Actor, least_gap_m: float) -> bool:
        """Put an object down unless another is too near; return whether it is there."""
        mine = footprints(actor.script, [0.0])
        others = (footprints(other.script, [0.0]) for other in self.actors)
        if any(gap_m(mine, other) < least_gap_m for other in others):
            return False
        self.actors.append(actor)
        self._footprints.append(footprints(actor.script, self.times_s.tolist()))
        return True

    def try_move(self, number: int, move: Move, ignored: tuple[int, ...] = ()) -> bool:
        """Let an object, and what it holds, make a move unless it meets another object."""
        actor = self.actors[number]
        free = (number, actor.holds, *ignored)
        if self._is_taken(move, actor.script, free):
            return False
        script = replace(actor.script, moves=(*actor.script.moves, move))
        mine = moved(self._footprints[number], script, self.times_s, move)
        for other, theirs in enumerate(self._footprints):
            if other in free or self.actors[other].inside is not None:
                continue
            # Objects that touched before may touch: they come no nearer.
            before = gap_m(self._footprints[number], theirs)
            if gap_m(mine, theirs) < min(self.setting.clearance_m, before - 1e-6):
                return False
        self._commit(number, script, mine, move.end_s)
        if actor.holds is not None:
            self._take_along(number, actor.holds, move)
        return True

    def _is_taken(self, move: Move, script: Script, free: tuple[int | None, ...]) -> bool:
        """Tell whether something stands at the end of a move, before the whole way is looked at."""
        after = self.times_s >= move.end_s
        for other, theirs in enumerate(self._footprints):
            if other in free or self.actors[other].inside is not None:
                continue
            near = theirs.centre[after, :2] - move.target_m
            reach = script.half_size_m[0] + theirs.half_m[after].min(axis=1)
            if (np.hypot(near[:, 0], near[:, 1]) < reach).any():
                return True
        return False

    def _take_along(self, number: int, held: int, move: Move) -> None:
        """Let a held object slide with its cone, or stay behind where the cone is lifted."""
        inner = self.actors[held]
        if not move.lift_m:
            script = replace(inner.script, moves=(*inner.script.moves, move))
            prints = moved(self._footprints[held], script, self.times_s, move)
            self._commit(held, script, prints, move.end_s)
            return
        self.actors[number].holds, inner.inside = None, None
        inner.free_s = move.end_s
        self.containments = [
            replace(entry, end_s=move.start_s) if self._is_open(entry, held) else entry
            for entry in self.containments
        ]

    @staticmethod
    def _is_open(entry: Containment, inner: int) -> bool:
        return entry.inner == inner and entry.end_s == math.inf

    def _commit(self, number: int, script: Script, prints: Footprints, free_s: float) -> None:
        self.actors[number].script = script
        self.actors[number].free_s = free_s
        self._footprints[number] = prints
