"""Short range: from one frame to the next by the nearest box, by correlation, or by either.

All trackers offer `follow`: where is a target in this frame, given where it is expected, which
candidate box was assigned to it, and how much of the expected place can be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np

from tcrdata.errors import SettingsError
from tcrdata.tracking.known_fits import KnownFits, lineage
from tcrdata.tracking.scenes import BoxView, Scene
from tcrdata.tracking.targets import Found, Target, yaw_step
from tcrdata.tracking.templates import (
    CorrelationSettings,
    Pose,
    Template,
    correlate,
    make_template,
    updated,
)
from tcrdata.types import FloatArray

TrackerName = Literal["nearest", "correlation", "auto"]
_TURN_RAD = 0.5


@dataclass(frozen=True)
class ShortRangeSettings:
    """When a match counts.

    Attributes:
        correlation: how templates are matched.
        least_score: mean correlation over the points in the box, in [0, 1].
        least_points_share: points in the box over those last seen, times the visible share.
        least_points: fewer points say nothing.
        least_visible_share: a place that shows less is not searched.
        update_sightings: a template learns from every so manieth sighting.
    """

    correlation: CorrelationSettings = field(default_factory=CorrelationSettings)
    least_score: float = 0.6
    least_points_share: float = 0.3
    least_points: int = 4
    least_visible_share: float = 0.25
    update_sightings: int = 3

    def __post_init__(self) -> None:
        """Refuse a rhythm of no sighting.

        Raises:
            SettingsError: `update_sightings` is below 1.
        """
        if self.update_sightings < 1:
            raise SettingsError("track.short.update_sightings: at least 1")


@dataclass(frozen=True)
class Match:
    """Where a target is.

    Attributes:
        box: (7,), world.
        found: how.
        score: in [0, 1].
        points: in the box; 0 when they were not counted.
        candidate: number of the candidate box that was taken, -1 for none.
        fit: (7,) box that the template fits; None where none does.
    """

    box: FloatArray
    found: Found
    score: float
    points: int
    candidate: int
    fit: FloatArray | None = None


class ShortRange(Protocol):
    """What every tracker from one frame to the next offers."""

    uses_candidates: bool

    def begin(self, target: Target, scene: Scene, candidate: int) -> None:
        """Learn what a new target looks like, and which candidate box it rides with."""
        ...

    def follow(
        self, target: Target, scene: Scene, expected: FloatArray, candidate: int, seen: BoxView
    ) -> Match | None:
        """Return where a target is; None when it is not found.

        Args:
            target: as it was seen last.
            scene: the frame.
            expected: (7,) box.
            candidate: number of the candidate that was assigned to the target, or -1.
            seen: what the frame shows of the expected box.
        """
        ...

    def learn(self, target: Target, scene: Scene, match: Match) -> None:
        """Take in what a target looks like now; only of the match that is taken."""
        ...


class NearestBox:
    """Takes the candidate box that was assigned to the target, as it is.

    A target that began with a true box keeps its size, and its place and turn relative to the
    candidate boxes: what the boxes' finder gets wrong every time does not matter then.
    """

    uses_candidates = True

    def begin(self, target: Target, scene: Scene, candidate: int) -> None:
        """Remember the candidate that the target begins with."""
        _ride(target, scene, candidate)

    def follow(
        self, target: Target, scene: Scene, expected: FloatArray, candidate: int, seen: BoxView
    ) -> Match | None:
        """Return the assigned candidate's box."""
        del expected, seen
        if candidate < 0:
            return None
        box = ridden(target, scene, candidate)
        _ride(target, scene, candidate)
        return Match(box, "nearest", float(scene.candidates.heat[candidate]), 0, candidate)

    def learn(self, target: Target, scene: Scene, match: Match) -> None:
        """Learn nothing: boxes have no look."""


class Correlation:
    """Matches a rigid template of the target, in features, against the frame's points."""

    uses_candidates = False

    def __init__(self, settings: ShortRangeSettings, known: KnownFits | None = None) -> None:
        self.settings = settings
        self._known = known

    def begin(self, target: Target, scene: Scene, candidate: int) -> None:
        """Make the template of the points in the target's box."""
        del candidate
        made = make_template(target.box, scene.points, scene.features, self.settings.correlation)
        if made is not None:
            made = replace(made, lineage=lineage(b"", scene.frame, target.box))
        target.template = made

    def follow(
        self, target: Target, scene: Scene, expected: FloatArray, candidate: int, seen: BoxView
    ) -> Match | None:
        """Return the place where the template fits best, when it fits well enough."""
        del candidate
        own = self.settings
        template = target.template
        if template is None or seen.visible_share < own.least_visible_share:
            return None
        pose = self._fit(template, expected, scene)
        if pose is None or pose.score < own.least_score:
            return None
        least = own.least_points_share * template.points * seen.visible_share
        if pose.points < max(least, own.least_points):
            return None
        return Match(pose.box, "correlation", min(pose.score, 1.0), pose.points, -1, pose.box)

    def learn(self, target: Target, scene: Scene, match: Match) -> None:
        """Add the points in the box that fits to the template, at every so manieth sighting."""
        own, template = self.settings, target.template
        if template is None or match.fit is None or target.sightings % own.update_sightings:
            return
        more = updated(template, match.fit, scene.points, scene.features, own.correlation)
        if more is not template:
            name = lineage(template.lineage, scene.frame, match.fit)
            target.template = replace(more, lineage=name)

    def _fit(self, template: Template, expected: FloatArray, scene: Scene) -> Pose | None:
        """Return where a template fits best around a (7,) box, from what is known or anew."""

        def find() -> Pose | None:
            own = self.settings.correlation
            return correlate(template, expected, scene.points, scene.features, own)

        if self._known is None:
            return find()
        name = lineage(template.lineage, scene.frame, expected)
        return self._known.pose(name, scene.frame, find)


class Either:
    """The nearest box where there is one, correlation where there is none.

    A target that began with a true box is rather correlated, from where the nearest box puts it:
    its size is known, and what the points show of it says more than another's box around them.
    """

    uses_candidates = True

    def __init__(self, settings: ShortRangeSettings, known: KnownFits | None = None) -> None:
        self._nearest = NearestBox()
        self._correlation = Correlation(settings, known)

    def begin(self, target: Target, scene: Scene, candidate: int) -> None:
        """Begin both ways."""
        self._nearest.begin(target, scene, candidate)
        self._correlation.begin(target, scene, candidate)

    def follow(
        self, target: Target, scene: Scene, expected: FloatArray, candidate: int, seen: BoxView
    ) -> Match | None:
        """Return the surer of the two."""
        start = expected if candidate < 0 else ridden(target, scene, candidate)
        correlated = self._correlation.follow(target, scene, start, candidate, seen)
        if correlated is not None and (target.rigid or candidate < 0):
            if candidate >= 0:
                target.box = correlated.box
                _ride(target, scene, candidate)
            return replace(correlated, candidate=candidate)
        nearest = self._nearest.follow(target, scene, expected, candidate, seen)
        if nearest is None or correlated is None:
            return nearest
        return replace(nearest, fit=correlated.fit)

    def learn(self, target: Target, scene: Scene, match: Match) -> None:
        """Learn as correlation does, from nearest boxes too where the template fits."""
        self._correlation.learn(target, scene, match)


def short_range(
    name: str, settings: ShortRangeSettings, known: KnownFits | None = None
) -> ShortRange:
    """Return a tracker by its name.

    Args:
        name: of it.
        settings: scaled to this world.
        known: fits that another pass over the same frames found, or where to leave them for one.

    Raises:
        SettingsError: there is none of that name.
    """
    if name == "nearest":
        return NearestBox()
    if name == "correlation":
        return Correlation(settings, known)
    if name == "auto":
        return Either(settings, known)
    raise SettingsError(f"no tracker '{name}': there are nearest, correlation, auto")


def ridden(target: Target, scene: Scene, candidate: int) -> FloatArray:
    """Return the (7,) box of a target that rides with a candidate."""
    found = scene.candidates.boxes[candidate]
    if not target.rigid:
        box: FloatArray = found.copy()
        box[6] = target.box[6] + yaw_step(target.box[6], found[6])
        return box
    box = target.box.copy()
    box[:3] = found[:3]
    if target.offset is not None:
        box[:3] += target.offset
        turn = yaw_step(target.candidate_yaw, float(found[6]))
        box[6] += turn if abs(turn) < _TURN_RAD else 0.0
    return box


def _ride(target: Target, scene: Scene, candidate: int) -> None:
    """Remember how a target lies relative to a candidate, the first time it takes one."""
    if candidate < 0:
        return
    found = scene.candidates.boxes[candidate]
    target.candidate_yaw = float(found[6])
    target.name = scene.candidates.names[candidate] or target.name
    if target.offset is None:
        target.offset = np.asarray(target.box[:3] - found[:3])
