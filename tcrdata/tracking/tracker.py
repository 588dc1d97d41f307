"""Follows objects through a sequence, one frame after another.

In each frame the targets that are in sight take what the short range finds; those out of sight go
on along every path of the library at once, and are found again where a path ends at something that
nobody else claims. What lies between is filled in along that path. Memory is bounded by the
longest time out of sight, not by the sequence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from tcrdata.geometry.boxes import bev_iou
from tcrdata.tracking.library import Library, basic_library, cut, joined
from tcrdata.tracking.long_range import Hypotheses, Volume, make_volume, sample
from tcrdata.tracking.scenes import BoxView, Scene, look
from tcrdata.tracking.short_range import Match, ShortRange
from tcrdata.tracking.targets import Found, Sighting, Target
from tcrdata.tracking.templates import correlate
from tcrdata.types import FloatArray

_FAR = 1e3


@dataclass(frozen=True)
class TrackerSettings:
    """Gates; metres are multiplied by the metric scale.

    Attributes:
        gate_m: largest distance of a candidate from the prediction.
        new_gate_m: the same for a target that was seen once, whose speed is unknown.
        gap_gate_m: the gate grows by this for each missing frame.
        name_gates: so many gates wide is the gate for a candidate that its finder linked to it.
        still_m: slower than this, in metres a frame, an object stands.
        link_gate_m: largest distance of what comes into sight from the end of a path.
        size_cost: cost, in gates, of a size that differs by a factor e.
        misses_frames: without a library, frames after which a target that is not found ends.
        hidden_frames: with one, the longest time out of sight.
        least_passable: mean p of a path that an object may have taken.
        young_frames: a target this young may turn out to be one that came back.
        overlap_iou: a candidate that overlaps a target more is no new one.
        margin_m: a return this much nearer hides what is behind it.
        voxel_m: of the volumes.
        speed_m: a first speed that differs by this, in metres a frame, costs a tenth of p.
    """

    gate_m: float = 1.3
    new_gate_m: float = 2.6
    gap_gate_m: float = 0.3
    name_gates: float = 2.0
    still_m: float = 0.04
    link_gate_m: float = 1.6
    size_cost: float = 0.3
    misses_frames: int = 3
    hidden_frames: int = 40
    least_passable: float = 0.99
    young_frames: int = 5
    overlap_iou: float = 0.1
    margin_m: float = 0.4
    voxel_m: float = 0.4
    speed_m: float = 0.3

    def scaled(self, metric_scale: float) -> TrackerSettings:
        """Return the settings with metres of this world."""
        metres = {
            name: value * metric_scale for name, value in vars(self).items() if name.endswith("_m")
        }
        return TrackerSettings(**{**vars(self), **metres})


@dataclass
class _Hidden:
    """A target out of sight."""

    target: Target
    hypotheses: Hypotheses
    frames: list[int] = field(default_factory=list)
    seen: list[BoxView] = field(default_factory=list)
    container: Target | None = None
    lost_box: FloatArray = field(default_factory=lambda: np.zeros(7))


@dataclass(frozen=True)
class Finished:
    """Rows of one tracklet that will not change any more."""

    number: int
    object_id: str
    rows: tuple[Sighting, ...]


class Tracker:
    """Follows every object of one segment of a sequence."""

    def __init__(
        self,
        short: ShortRange,
        library: Library | None,
        settings: TrackerSettings,
        *,
        first_number: int = 0,
        starts: Mapping[int, Sequence[tuple[str, FloatArray]]] | None = None,
    ) -> None:
        """Start with nothing in sight.

        Args:
            short: from one frame to the next.
            library: None for short range alone.
            settings: scaled to this world.
            first_number: of the tracklets.
            starts: frame to (object id, (7,) box in the world) that tracklets begin with; None
                lets them begin with candidates.
        """
        self._short = short
        self._library = library
        self._own = settings
        self._starts = starts
        self._targets: list[Target] = []
        self._hidden: list[_Hidden] = []
        self.next_number = first_number
        self._last_frame: int | None = None

    def step(self, scene: Scene) -> Iterator[Finished]:
        """Take a frame in; yield what is settled."""
        own = self._own
        volume = make_volume(scene, self._unseen_places(scene), own.voxel_m, own.margin_m)
        claimed = np.zeros(len(scene.candidates.boxes), dtype=bool)
        expected = [t.predicted(scene.frame, own.still_m) for t in self._targets]
        assigned = self._assigned(scene, expected)
        before, lost = {t.number: t.box for t in self._targets}, []
        for target, box, candidate in zip(list(self._targets), expected, assigned, strict=True):
            seen = look(scene.view, box, own.margin_m)
            match = self._short.follow(target, scene, box, candidate, seen)
            if match is None:
                lost.append((target, box, seen))
                continue
            if candidate >= 0:
                claimed[candidate] = True
            self._see(target, scene, match, volume)
        for target, box, seen in lost:
            self._lose(target, scene, box, seen)
        yield from self._go_on(scene, volume, before)
        self._find_again(scene, volume, claimed)
        yield from self._begin(scene, volume, claimed)
        yield from self._settled()
        self._last_frame = scene.frame

    def finish(self) -> Iterator[Finished]:
        """Yield the rest."""
        for hidden in self._hidden:
            yield self._ended(hidden)
        for target in self._targets:
            yield _handed_on(target, 0)
        self._targets, self._hidden = [], []

    def _unseen_places(self, scene: Scene) -> FloatArray:
        """Return (N, 3) places where what is out of sight may be in this frame."""
        places = [np.zeros((0, 3), np.float32)]
        for hidden in self._hidden:
            steps = self._steps_to(hidden, scene.frame)
            if steps <= hidden.hypotheses.longest:
                places.append(hidden.hypotheses.places_after(steps))
        return np.concatenate(places).astype(np.float64)

    def _steps_to(self, hidden: _Hidden, frame: int) -> int:
        last = hidden.frames[-1] if hidden.frames else hidden.target.frame
        return hidden.hypotheses.steps + frame - last

    def _assigned(self, scene: Scene, expected: list[FloatArray]) -> list[int]:
        """Return each target's candidate, -1 without one: the cheapest assignment within gates."""
        boxes = scene.candidates.boxes
        if not self._short.uses_candidates or not expected or not len(boxes):
            return [-1] * len(expected)
        cost = np.full((len(expected), len(boxes)), _FAR)
        for row, (target, box) in enumerate(zip(self._targets, expected, strict=True)):
            gate = self._own.gate_m if target.knows_motion else self._own.new_gate_m
            gate += self._own.gap_gate_m * (scene.frame - target.frame - 1)
            gate = max(gate, 0.5 * float(box[3:5].min()))
            place = box[:3] - (target.offset if target.rigid and target.offset is not None else 0)
            apart = np.linalg.norm(boxes[:, :3] - place, axis=1) / gate
            named = np.array([n is not None and n == target.name for n in scene.candidates.names])
            size = np.abs(np.log(boxes[:, 3:6].prod(axis=1) / max(box[3:6].prod(), 1e-9))) / 3
            near = apart <= np.where(named, self._own.name_gates, 1.0)
            full = apart + self._own.size_cost * size - named
            cost[row] = np.where(near, full, _FAR)
        result = [-1] * len(expected)
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if cost[row, column] < _FAR:
                result[row] = int(column)
        return result

    def _see(self, target: Target, scene: Scene, match: Match, volume: Volume) -> None:
        seen = look(scene.view, match.box, self._own.margin_m)
        points = match.points or _count(scene, match.box)
        target.see(
            Sighting(
                scene.frame, match.box, match.found, seen.visible_share, match.score, points,
                _passable(volume, match.box), match.candidate,
            )
        )  # fmt: skip

    def _lose(self, target: Target, scene: Scene, box: FloatArray, seen: BoxView) -> None:
        """Put a target out of sight: every path of the library begins where it was seen last."""
        self._targets.remove(target)
        frames = self._own.misses_frames if self._library is None else self._own.hidden_frames
        velocity = target.velocity
        if float(np.linalg.norm(velocity)) <= self._own.still_m:
            velocity = np.zeros(3)
        library = basic_library(frames, float(np.hypot(velocity[0], velocity[2])))
        if self._library is not None and len(self._library):
            library = cut(joined(library, self._library), frames)
        hypotheses = Hypotheses(library, target.box, velocity, self._own.speed_m)
        hidden = _Hidden(target, hypotheses, lost_box=target.box)
        if self._library is not None and seen.visible_share < 0.5:
            hidden.container = self._container(target, box)
        self._hidden.append(hidden)

    def _container(self, target: Target, box: FloatArray) -> Target | None:
        """Return the larger target in sight whose box holds a target's place; None without one."""
        area = target.box[3] * target.box[4]
        for other in self._targets:
            there = other.box
            c, s = np.cos(there[6]), np.sin(there[6])
            dx, dz = box[0] - there[0], box[2] - there[2]
            inside = abs(c * dx - s * dz) <= there[3] / 2 and abs(s * dx + c * dz) <= there[4] / 2
            if inside and there[3] * there[4] > area:
                return other
        return None

    def _go_on(
        self, scene: Scene, volume: Volume, before: dict[int, FloatArray]
    ) -> Iterator[Finished]:
        """Let what is out of sight go on by a frame; end what has been so for too long."""
        for hidden in list(self._hidden):
            steps = self._steps_to(hidden, scene.frame) - hidden.hypotheses.steps
            if hidden.hypotheses.steps + steps > hidden.hypotheses.longest:
                self._hidden.remove(hidden)
                yield self._ended(hidden)
                continue
            hidden.hypotheses.advance(volume, steps)
            box = hidden.container
            if box is not None and box.frame == scene.frame and box.number in before:
                hidden.hypotheses.carry(box.box[:3] - before[box.number][:3])
            hidden.frames.append(scene.frame)
            hidden.seen.append(
                look(scene.view, hidden.hypotheses.box(self._best(hidden)), self._own.margin_m)
            )

    def _best(self, hidden: _Hidden) -> int:
        """Return the path that an object out of sight most likely takes."""
        prior = np.zeros(len(hidden.hypotheses.passable))
        if hidden.container is not None:
            prior[1:] = 1.0
        return hidden.hypotheses.best(prior)

    def _find_again(self, scene: Scene, volume: Volume, claimed: np.ndarray) -> None:
        """Link what is out of sight to what nobody claims, or to targets that began just now."""
        young = [
            t
            for t in self._targets
            if self._starts is None and t.sightings <= self._own.young_frames and not t.rigid
        ]
        free = np.flatnonzero(~claimed) if self._short.uses_candidates else np.empty(0, dtype=int)
        boxes = np.array([*scene.candidates.boxes[free], *[t.box for t in young]]).reshape(-1, 7)
        cost = np.full((len(self._hidden), len(boxes)), _FAR)
        for row, hidden in enumerate(self._hidden):
            for column, box in enumerate(boxes):
                other = young[column - len(free)] if column >= len(free) else None
                if other is None or other.rows[0].frame > hidden.target.frame:
                    cost[row, column] = self._link_cost(hidden, box, other)
        linked = []
        if cost.size:
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] < _FAR:
                    linked.append((self._hidden[row], int(column)))
        for hidden, column in linked:
            self._hidden.remove(hidden)
            if column < len(free):
                candidate = int(free[column])
                claimed[candidate] = True
                self._come_back(hidden, scene, candidate, volume)
            else:
                self._merge(hidden, young[column - len(free)])
        for hidden in list(self._hidden):
            self._search(hidden, scene, volume)

    def _link_cost(self, hidden: _Hidden, box: FloatArray, other: Target | None) -> float:
        """Return how far a box is from where an object out of sight may be, in gates."""
        hypotheses, own = hidden.hypotheses, self._own
        if other is None:
            places = hypotheses.places
        else:
            step = hypotheses.steps - (hidden.frames[-1] - other.rows[0].frame)
            if step < 1:
                return _FAR
            places = np.array(
                [hypotheses.box(k, step)[:3] for k in range(len(hypotheses.passable))]
            )
            box = other.rows[0].box
        able = hypotheses.passable >= own.least_passable
        able[:2] |= self._library is None
        if not able.any():
            return _FAR
        apart = np.linalg.norm(places[able] - box[:3], axis=1).min() / own.link_gate_m
        size = abs(float(np.log(box[3:6].prod() / max(hidden.target.box[3:6].prod(), 1e-9)))) / 3
        cost = float(apart + own.size_cost * size)
        return cost if apart <= 1 else _FAR

    def _come_back(self, hidden: _Hidden, scene: Scene, candidate: int, volume: Volume) -> None:
        """See a hidden target again, in a candidate box."""
        target = hidden.target
        box = scene.candidates.boxes[candidate].copy()
        place = hidden.hypotheses.places
        nearest = int(np.argmin(np.linalg.norm(place - box[:3], axis=1)))
        start = hidden.hypotheses.box(nearest)
        seen = look(scene.view, box, self._own.margin_m)
        if target.rigid:
            start[:3] = box[:3] + (0 if target.offset is None else target.offset)
        target.box = start
        match = self._short.follow(target, scene, start, candidate, seen)
        if match is None:
            match = Match(box, "nearest", float(scene.candidates.heat[candidate]), 0, candidate)
        self._fill(hidden, nearest, hidden.frames[:-1], match.box, scene.frame)
        self._see(target, scene, match, volume)
        self._targets.append(target)

    def _search(self, hidden: _Hidden, scene: Scene, volume: Volume) -> None:
        """Look for a hidden target's template where the likeliest paths are in sight."""
        target, hypotheses = hidden.target, hidden.hypotheses
        if target.template is None:
            return
        order = np.argsort(-(hypotheses.passable - hypotheses._cost), kind="stable")[:3]
        tried = []
        for path in {int(k): None for k in (*order, 0)}:
            box = hypotheses.box(path)
            seen = look(scene.view, box, self._own.margin_m)
            match = self._short.follow(target, scene, box, -1, seen)
            if match is not None and match.found == "correlation":
                tried.append((match.score, -path, match))
        if not tried:
            return
        _, path, match = max(tried, key=lambda entry: entry[:2])
        others = np.array([t.box for t in self._targets]).reshape(-1, 7)
        if len(others) and bev_iou(match.box[None], others).max() > self._own.overlap_iou * 3:
            return
        self._hidden.remove(hidden)
        self._fill(hidden, -path, hidden.frames[:-1], match.box, scene.frame)
        self._see(target, scene, match, volume)
        self._targets.append(target)

    def _merge(self, hidden: _Hidden, young: Target) -> None:
        """A target that began a few frames ago is the hidden one come back."""
        target = hidden.target
        first = young.rows[0]
        gap = [frame for frame in hidden.frames if frame < first.frame]
        step = hidden.hypotheses.steps - (hidden.frames[-1] - first.frame)
        places = np.array(
            [hidden.hypotheses.box(k, step)[:3] for k in range(len(hidden.hypotheses.passable))]
        )
        path = int(np.argmin(np.linalg.norm(places - first.box[:3], axis=1)))
        self._fill(hidden, path, gap, first.box, first.frame)
        self._targets.remove(young)
        for row in young.rows:
            target.see(row)
        target.template, target.name = young.template, young.name
        target.offset, target.candidate_yaw = young.offset, young.candidate_yaw
        self._targets.append(target)

    def _fill(
        self,
        hidden: _Hidden,
        path: int,
        frames: Sequence[int],
        end: FloatArray | None = None,
        at: int = 0,
    ) -> None:
        """Fill frames out of sight in along a path, bent so that it ends where the object is."""
        target, hypotheses = hidden.target, hidden.hypotheses
        bend = np.zeros(3)
        whole = 1
        if end is not None:
            whole = max(at - self._lost_frame(hidden), 1)
            bend = end[:3] - hypotheses.box(path, whole)[:3]
        found: Found = "interpolated" if self._library is None else "library"
        if hidden.container is not None and path == 0:
            found = "container"
        for frame, seen in zip(frames, hidden.seen, strict=False):
            step = frame - self._lost_frame(hidden)
            box = hypotheses.box(path, step)
            box[:3] += bend * (step / whole)
            target.rows.append(
                Sighting(
                    frame, box, found, seen.visible_share, None, 0,
                    float(hypotheses.passable[path]),
                )
            )  # fmt: skip

    def _lost_frame(self, hidden: _Hidden) -> int:
        return hidden.frames[-1] - hidden.hypotheses.steps if hidden.frames else 0

    def _ended(self, hidden: _Hidden) -> Finished:
        """End a hidden target; its likeliest path stays while it could be taken unseen."""
        if self._library is not None and hidden.frames:
            path = self._best(hidden)
            if hidden.hypotheses.passable[path] >= self._own.least_passable:
                self._fill(hidden, path, hidden.frames)
        return _handed_on(hidden.target, 0)

    def _begin(self, scene: Scene, volume: Volume, claimed: np.ndarray) -> Iterator[Finished]:
        """Start tracklets: with what is given for this frame, or with what nobody claims."""
        if self._starts is not None:
            for object_id, box in self._starts.get(scene.frame, ()):
                candidate = self._own_candidate(scene, box, claimed)
                self._start(scene, volume, box, candidate, object_id)
            return
        there = np.array([t.box for t in self._targets]).reshape(-1, 7)
        for candidate in np.flatnonzero(~claimed & scene.candidates.starts):
            box = scene.candidates.boxes[candidate]
            taken = len(there) and bev_iou(box[None], there).max() > self._own.overlap_iou
            if not taken:
                self._start(scene, volume, box.copy(), int(candidate), "")
        yield from ()

    def _own_candidate(self, scene: Scene, box: FloatArray, claimed: np.ndarray) -> int:
        """Return the unclaimed candidate that overlaps a box most, -1 without one."""
        boxes = scene.candidates.boxes
        if not len(boxes):
            return -1
        overlap = np.where(claimed, 0.0, bev_iou(box[None], boxes)[0])
        best = int(overlap.argmax())
        return best if overlap[best] > self._own.overlap_iou else -1

    def _start(
        self, scene: Scene, volume: Volume, box: FloatArray, candidate: int, object_id: str
    ) -> None:
        rigid = self._starts is not None
        target = Target(self.next_number, box, scene.frame, rigid, object_id)
        self.next_number += 1
        if candidate >= 0:
            target.name = scene.candidates.names[candidate]
        self._short.begin(target, scene, candidate)
        heat = float(scene.candidates.heat[candidate]) if candidate >= 0 else 1.0
        found: Found = "given" if rigid else "nearest"
        self._see(target, scene, Match(box, found, heat, 0, candidate), volume)
        self._targets.append(target)

    def _settled(self) -> Iterator[Finished]:
        """Hand on the rows that can no longer be merged away."""
        for target in [*self._targets, *(hidden.target for hidden in self._hidden)]:
            if target.sightings > self._own.young_frames and target.rows:
                yield _handed_on(target, 0)


def _handed_on(target: Target, kept: int) -> Finished:
    rows = target.rows[: len(target.rows) - kept]
    target.rows = target.rows[len(rows) :]
    return Finished(target.number, target.object_id, tuple(rows))


def _passable(volume: Volume, box: FloatArray) -> float:
    return float(sample(volume, box[None, :3].astype(np.float32))[0])


def _count(scene: Scene, box: FloatArray) -> int:
    from tcrdata.geometry.boxes import points_in_box

    return int(points_in_box(scene.points, box).sum())
