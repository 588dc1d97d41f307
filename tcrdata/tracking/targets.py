"""An object that is followed: where it is, how it moves, what it looks like."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tcrdata.tracking.templates import Template
from tcrdata.types import FloatArray

Found = Literal["given", "nearest", "correlation", "library", "container", "interpolated"]
VELOCITY_FRAMES = 4


@dataclass(frozen=True)
class Sighting:
    """A tracklet's box in one frame: a row of `tracklets`, in the world.

    Attributes:
        frame: number of the frame.
        box: (7,).
        found: how.
        visible_share: share of rays to the box that nothing stops before it.
        score: of the match, in [0, 1]; None where nothing was matched.
        points: in the box.
        passable: p at the box's centre (eq. 9).
        candidate: number of the candidate box that was taken, -1 for none.
    """

    frame: int
    box: FloatArray
    found: Found
    visible_share: float
    score: float | None
    points: int
    passable: float
    candidate: int = -1


@dataclass
class Target:
    """A tracklet that grows.

    Attributes:
        number: of the tracklet in its sequence.
        box: (7,) where it was seen last.
        frame: number of that frame.
        rigid: its first box is true: size and offset from what is found stay as they were then.
        object_id: of the labelled object that it began with; empty without one.
        name: the track that its candidates were linked to by their finder.
        template: what it looks like; None while unknown.
        offset: (3,) from the candidate box that it rides with to its own centre; None before the
            first one.
        candidate_yaw: of the candidate it was last found with.
        path: (frame, centre) of the last sightings.
        rows: sightings that are not handed on yet.
        sightings: how many there were.
    """

    number: int
    box: FloatArray
    frame: int
    rigid: bool
    object_id: str = ""
    name: str | None = None
    template: Template | None = None
    offset: FloatArray | None = None
    candidate_yaw: float = 0.0
    path: deque[tuple[int, FloatArray]] = field(
        default_factory=lambda: deque(maxlen=VELOCITY_FRAMES)
    )
    rows: list[Sighting] = field(default_factory=list)
    sightings: int = 0

    @property
    def knows_motion(self) -> bool:
        """Whether it was seen twice or more."""
        return len(self.path) > 1

    @property
    def velocity(self) -> FloatArray:
        """(3,) metres a frame, over the last sightings; zero while unknown."""
        if not self.knows_motion:
            return np.zeros(3)
        (first, start), (last, end) = self.path[0], self.path[-1]
        return np.asarray((end - start) / max(last - first, 1))

    def predicted(self, frame: int, still_m: float) -> FloatArray:
        """Return the (7,) box at a frame: constant velocity; below `still_m` a frame it stands."""
        velocity = self.velocity
        box = self.box.copy()
        if float(np.linalg.norm(velocity)) > still_m:
            box[:3] += velocity * (frame - self.frame)
        return box

    def see(self, sighting: Sighting) -> None:
        """Take a sighting in."""
        self.box, self.frame = sighting.box, sighting.frame
        self.path.append((sighting.frame, sighting.box[:3].copy()))
        self.rows.append(sighting)
        self.sightings += 1


def yaw_step(before: float, after: float, period: float = math.pi) -> float:
    """Return the smallest turn between two directions that repeat every period."""
    return math.remainder(after - before, period)
