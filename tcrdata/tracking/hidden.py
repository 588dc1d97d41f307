"""Objects out of sight: where each may be, what holds it, and how its tracklet is filled in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tcrdata.geometry.boxes import points_in_box
from tcrdata.tracking.long_range import Hypotheses
from tcrdata.tracking.scenes import BoxView
from tcrdata.tracking.targets import Found, Sighting, Target
from tcrdata.types import FloatArray

UNLINKED = 1e3


@dataclass
class Hidden:
    """A target out of sight.

    Attributes:
        target: as it was seen last.
        hypotheses: every path of the library from there on; the first one stays.
        linked: how frames out of sight are said to be found.
        frames: seen since, without it.
        seen: what each of these showed of its likeliest place.
        container: a target in sight whose box holds it; it goes where that one goes.
        container_box: (7,) of the container in the last frame.
    """

    target: Target
    hypotheses: Hypotheses
    linked: Found
    frames: list[int] = field(default_factory=list)
    seen: list[BoxView] = field(default_factory=list)
    container: Target | None = None
    container_box: FloatArray = field(default_factory=lambda: np.zeros(7))

    def steps_at(self, frame: int) -> int:
        """Return how many steps of the paths lead to a frame."""
        return frame - self.target.frame

    @property
    def best(self) -> int:
        """The path that it most likely takes."""
        prior = np.zeros(len(self.hypotheses.passable))
        if self.container is not None:
            prior[1:] = 1.0
        return self.hypotheses.best(prior)

    def enter(self, container: Target | None) -> None:
        """Be inside a target from now on, where there is one."""
        self.container = container
        if container is not None:
            self.container_box = container.box

    def ride(self, frame: int) -> None:
        """Move along with the container, as far as that has moved since the last frame."""
        if self.container is not None and self.container.frame == frame:
            self.hypotheses.carry(self.container.box[:3] - self.container_box[:3])
            self.container_box = self.container.box

    def nearest(self, place: FloatArray, frame: int) -> int:
        """Return the path that comes nearest to a place in a frame."""
        places = self.hypotheses.places_after(self.steps_at(frame))
        return int(np.argmin(np.linalg.norm(places - place, axis=1)))

    def fill(
        self,
        path: int,
        frames: Sequence[int],
        end: FloatArray | None = None,
        end_frame: int = 0,
    ) -> None:
        """Add rows for frames out of sight, along a path bent so that it ends where the object is.

        Args:
            path: number of it.
            frames: a beginning of those out of sight.
            end: (3,) where it was found again; None when it was not.
            end_frame: in which frame.
        """
        bend, whole = np.zeros(3), 1
        if end is not None:
            whole = self.steps_at(end_frame)
            bend = end - self.hypotheses.box(path, whole)[:3]
        found: Found = self.linked
        if self.container is not None and path == 0:
            found = "container"
        passable = float(self.hypotheses.passable[path])
        for frame, seen in zip(frames, self.seen, strict=False):
            step = self.steps_at(frame)
            box = self.hypotheses.box(path, step)
            box[:3] += bend * (step / whole)
            row = Sighting(frame, box, found, seen.visible_share, None, 0, passable)
            self.target.rows.append(row)


def link_cost(
    hidden: Hidden,
    box: FloatArray,
    frame: int,
    *,
    gate_m: float,
    size_cost: float,
    least_passable: float,
) -> float:
    """Return how far a box is from where an object out of sight may be.

    Args:
        hidden: the object.
        box: (7,) that nobody else claims.
        frame: in which it is.
        gate_m: farther than this from every path is too far.
        size_cost: cost, in gates, of a size that differs by a factor e.
        least_passable: mean p of a path that it may have taken.

    Returns:
        the distance in gates, or UNLINKED.
    """
    able = hidden.hypotheses.passable >= least_passable
    steps = hidden.steps_at(frame)
    if not able.any() or steps < 1:
        return UNLINKED
    places = hidden.hypotheses.places_after(steps)[able]
    apart = float(np.linalg.norm(places - box[:3], axis=1).min()) / gate_m
    volume, before = (max(float(b[3:6].prod()), 1e-9) for b in (box, hidden.target.box))
    cost = apart + size_cost * abs(float(np.log(volume / before))) / 3
    return cost if apart <= 1 else UNLINKED


def container_of(box: FloatArray, targets: Sequence[Target]) -> Target | None:
    """Return the target with a larger footprint whose box holds a (7,) box's centre."""
    for other in targets:
        larger = other.box[3] * other.box[4] > box[3] * box[4]
        if larger and points_in_box(box[None, :3], other.box)[0]:
            return other
    return None
