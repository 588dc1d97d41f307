"""Follows objects through a sequence, one frame after another.

In each frame the targets that are in sight take what the short range finds; those out of sight go
on along every path of the library at once, and are found again where a path ends at something that
nobody else claims. What lies between is filled in along that path. Memory is bounded by the
longest time out of sight, not by the sequence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.geometry.boxes import bev_iou
from tcrdata.tracking.assignment import assigned, cheapest
from tcrdata.tracking.cell_points import number_inside
from tcrdata.tracking.hidden import Hidden, container_of, link_cost
from tcrdata.tracking.library import Library, basic_library, cut, joined
from tcrdata.tracking.long_range import Hypotheses, Volume, make_volume, sample
from tcrdata.tracking.scenes import Scene, look
from tcrdata.tracking.short_range import Match, ShortRange
from tcrdata.tracking.targets import Found, Sighting, Target
from tcrdata.tracking.tracker_settings import TrackerSettings
from tcrdata.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Finished:
    """Rows of one tracklet that will not change any more, and whether more may follow."""

    number: int
    object_id: str
    rows: tuple[Sighting, ...]
    over: bool


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
        self._hidden: list[Hidden] = []
        self.next_number = first_number

    def step(self, scene: Scene) -> Iterator[Finished]:
        """Take a frame in; yield what is settled."""
        own = self._own
        yield from self._give_up(scene)
        volume = make_volume(scene, self._unseen_places(scene), own.voxel_m, own.margin_m)
        claimed = self._follow(scene, volume)
        yield from self._give_up(scene)
        for hidden in self._hidden:
            hidden.hypotheses.advance(
                volume, hidden.steps_at(scene.frame) - hidden.hypotheses.steps
            )
            hidden.ride(scene.frame)
            self._hold(hidden, scene.frame)
            hidden.frames.append(scene.frame)
            hidden.seen.append(look(scene.view, hidden.hypotheses.box(hidden.best), own.margin_m))
        self._link(scene, volume, claimed)
        self._search(scene, volume)
        if self._starts is None:
            self._begin(scene, volume, claimed)
        else:
            for object_id, box in self._starts.get(scene.frame, ()):
                candidate = self._candidate_at(scene, box, claimed)
                self._start(scene, volume, box, candidate, object_id)
        yield from self._settled()

    def finish(self) -> Iterator[Finished]:
        """Yield the rest."""
        for hidden in self._hidden:
            yield self._ended(hidden)
        for target in self._targets:
            yield _handed_on(target, over=True)
        self._targets, self._hidden = [], []

    def _follow(self, scene: Scene, volume: Volume) -> BoolArray:
        """See the targets in sight again, or lose them; return which candidates are claimed."""
        own = self._own
        claimed = np.zeros(len(scene.candidates.boxes), dtype=bool)
        expected = [t.predicted(scene.frame, own.still_m) for t in self._targets]
        chosen = [-1] * len(expected)
        if self._short.uses_candidates:
            chosen = assigned(self._targets, expected, scene.candidates, scene.frame, own.near)
        lost = []
        for target, box, candidate in zip(self._targets, expected, chosen, strict=True):
            seen = look(scene.view, box, own.margin_m)
            match = self._short.follow(target, scene, box, candidate, seen)
            if match is None:
                lost.append(target)
                continue
            if candidate >= 0:
                claimed[candidate] = True
            self._see(target, scene, match, volume)
        gone = {target.number for target in lost}
        self._targets = [target for target in self._targets if target.number not in gone]
        self._hidden += [self._lost(target) for target in lost]
        return claimed

    def _see(self, target: Target, scene: Scene, match: Match, volume: Volume) -> None:
        seen = look(scene.view, match.box, self._own.margin_m)
        points = match.points or number_inside(scene.points, match.box)
        passable = float(sample(volume, match.box[None, :3].astype(np.float32))[0])
        # What was matched is object-like as far as it matches.
        passable = max(passable, match.score)
        self._short.learn(target, scene, match)
        target.see(
            Sighting(
                scene.frame, match.box, match.found, seen.visible_share, match.score, points,
                passable, match.candidate,
            )
        )  # fmt: skip

    def _lost(self, target: Target) -> Hidden:
        """Return a target as out of sight: every path begins where it was seen last."""
        own = self._own
        frames = own.misses_frames if self._library is None else own.hidden_frames
        velocity = target.velocity
        if float(np.linalg.norm(velocity)) <= own.still_m:
            velocity = np.zeros(3)
        library = basic_library(frames, float(np.hypot(velocity[0], velocity[2])))
        if self._library is not None and len(self._library):
            library = cut(joined(library, self._library), frames)
        hypotheses = Hypotheses(library, target.box, velocity, own.speed_m)
        return Hidden(target, hypotheses, "interpolated" if self._library is None else "library")

    def _hold(self, hidden: Hidden, frame: int) -> None:
        """Say what holds a target that is out of sight since a few frames, where something does."""
        fresh = hidden.steps_at(frame) <= self._own.contained_frames
        if self._library is not None and hidden.container is None and fresh:
            hidden.enter(container_of(hidden.hypotheses.box(0), self._targets))

    def _give_up(self, scene: Scene) -> Iterator[Finished]:
        """End what has been out of sight for too long."""
        kept = []
        for hidden in self._hidden:
            if hidden.steps_at(scene.frame) > hidden.hypotheses.longest:
                yield self._ended(hidden)
            else:
                kept.append(hidden)
        self._hidden = kept

    def _unseen_places(self, scene: Scene) -> FloatArray:
        """Return (N, 3) places where what is out of sight may be in this frame."""
        places = [np.zeros((0, 3), np.float32)]
        places += [h.hypotheses.places_after(h.steps_at(scene.frame)) for h in self._hidden]
        return np.concatenate(places).astype(np.float64)

    def _link(self, scene: Scene, volume: Volume, claimed: BoolArray) -> None:
        """Link what is out of sight to what nobody claims, or to targets that began just now."""
        own = self._own
        if not self._short.uses_candidates:
            return
        free = np.flatnonzero(~claimed)
        young = [t for t in self._targets if not t.rigid and t.sightings <= own.young_frames]
        places = [(scene.candidates.boxes[i], scene.frame, -1) for i in free]
        places += [(t.rows[0].box, t.rows[0].frame, t.number) for t in young]
        # Without a library nothing asks what lies on the way.
        least = own.least_passable if self._library is not None else 0.0
        cost = np.array([
            [
                link_cost(
                    hidden, box, frame, gate_m=own.link_gate_m, size_cost=own.near.size_cost,
                    least_passable=least,
                )
                for box, frame, _ in places
            ]
            for hidden in self._hidden
        ]).reshape(len(self._hidden), len(places))  # fmt: skip
        back = [(self._hidden[row], column) for row, column in zip(*cheapest(cost), strict=True)]
        for hidden, column in back:
            self._hidden.remove(hidden)
            if column < len(free):
                claimed[free[column]] = True
                self._come_back(hidden, scene, int(free[column]), volume)
            else:
                self._merge(hidden, young[column - len(free)])

    def _come_back(self, hidden: Hidden, scene: Scene, candidate: int, volume: Volume) -> None:
        """See a hidden target again, in a candidate box."""
        target = hidden.target
        box = scene.candidates.boxes[candidate]
        path = hidden.nearest(box[:3], scene.frame)
        expected = hidden.hypotheses.box(path)
        seen = look(scene.view, box, self._own.margin_m)
        match = self._short.follow(target, scene, expected, candidate, seen)
        if match is not None:
            hidden.fill(path, hidden.frames[:-1], match.box[:3], scene.frame)
            self._see(target, scene, match, volume)
        self._targets.append(target)

    def _merge(self, hidden: Hidden, young: Target) -> None:
        """Let a target that began a few frames ago be the hidden one come back."""
        target, first = hidden.target, young.rows[0]
        gap = [frame for frame in hidden.frames if frame < first.frame]
        path = hidden.nearest(first.box[:3], first.frame)
        hidden.fill(path, gap, first.box[:3], first.frame)
        self._targets.remove(young)
        for row in young.rows:
            target.see(row)
        target.template, target.name = young.template, young.name
        target.offset, target.candidate_yaw = young.offset, young.candidate_yaw
        self._targets.append(target)

    def _search(self, scene: Scene, volume: Volume) -> None:
        """Look for what is out of sight where its likeliest paths are in sight."""
        for hidden in list(self._hidden):
            if hidden.target.template is None or hidden.frames[-1] != scene.frame:
                continue
            tried = []
            for path in dict.fromkeys([0, *hidden.hypotheses.likeliest(3)]):
                box = hidden.hypotheses.box(path)
                seen = look(scene.view, box, self._own.margin_m)
                match = self._short.follow(hidden.target, scene, box, -1, seen)
                if match is not None:
                    tried.append((match.score, -path, match))
            if not tried:
                continue
            _, path, match = max(tried, key=lambda entry: entry[:2])
            others = np.array([t.box for t in self._targets]).reshape(-1, 7)
            if len(others) and bev_iou(match.box[None], others).max() > self._own.overlap_iou:
                continue
            self._hidden.remove(hidden)
            hidden.fill(-path, hidden.frames[:-1], match.box[:3], scene.frame)
            self._see(hidden.target, scene, match, volume)
            self._targets.append(hidden.target)

    def _ended(self, hidden: Hidden) -> Finished:
        """End a hidden target; of what nobody saw again only what rides inside another stays."""
        if hidden.container is not None and hidden.frames:
            path = hidden.best
            if hidden.hypotheses.passable[path] >= self._own.least_passable:
                hidden.fill(path, hidden.frames)
        return _handed_on(hidden.target, over=True)

    def _begin(self, scene: Scene, volume: Volume, claimed: BoolArray) -> None:
        """Start tracklets with what nobody claims."""
        there = np.array([t.box for t in self._targets]).reshape(-1, 7)
        for candidate in np.flatnonzero(~claimed & scene.candidates.starts):
            box = scene.candidates.boxes[candidate]
            taken = len(there) and bev_iou(box[None], there).max() > self._own.overlap_iou
            if not taken:
                self._start(scene, volume, box.copy(), int(candidate), "")

    def _candidate_at(self, scene: Scene, box: FloatArray, claimed: BoolArray) -> int:
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
        self._short.begin(target, scene, candidate)
        heat = float(scene.candidates.heat[candidate]) if candidate >= 0 else 1.0
        found: Found = "given" if rigid else "nearest"
        self._see(target, scene, Match(box, found, heat, 0, candidate), volume)
        self._targets.append(target)

    def _settled(self) -> Iterator[Finished]:
        """Hand on the rows that can no longer be merged away."""
        for target in [*self._targets, *(hidden.target for hidden in self._hidden)]:
            if target.sightings > self._own.young_frames and target.rows:
                yield _handed_on(target, over=False)


def _handed_on(target: Target, *, over: bool) -> Finished:
    rows, target.rows = tuple(target.rows), []
    return Finished(target.number, target.object_id, rows, over)
