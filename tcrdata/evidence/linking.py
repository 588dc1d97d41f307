"""Links the clusters of consecutive frames into tracks, in the world.

One frame after another: constant-velocity prediction, then assignment (Hungarian) in tiers. Tracks
that have proven themselves choose first, within a narrow gate; tracks of one sighting, whose speed
is unknown, choose next within a wide one. So clutter, which rarely repeats, cannot take a cluster
away from a track that expects it. Every cluster takes part: nothing is gated by its quality.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tcrdata.types import FloatArray, IntArray


@dataclass(frozen=True)
class LinkingSettings:
    """Gates of the association; metres are multiplied by the metric scale.

    Attributes:
        gate_m: largest distance from the prediction, for tracks with a speed.
        new_gate_m: largest step of a track of one sighting, from one frame to the next.
        fast_gate_m: the same for what is left over afterwards (40 m/s at 10 Hz).
        gap_gate_m: the first gate grows by this for every frame that is missing since the last
            sighting: nothing could be seen there.
        misses_frames: usable frames without a sighting after which a track ends.
        velocity_frames: sightings back over which the speed is taken.
        core_cost: cost, in gates, of a cluster without any core point.
        size_cost: cost, in gates, of a size that differs by a factor e.
    """

    gate_m: float = 1.3
    new_gate_m: float = 2.6
    fast_gate_m: float = 4.0
    gap_gate_m: float = 0.3
    misses_frames: int = 3
    velocity_frames: int = 3
    core_cost: float = 0.5
    size_cost: float = 0.25


@dataclass(frozen=True)
class Detections:
    """Clusters of one sequence, sorted by frame.

    Attributes:
        frame: (N,) frame numbers, rising.
        position: (N, 2) x and z in the world, metres.
        size_m: (N,) diagonal of the footprint.
        core_share: (N,) share of core points.
        usable: numbers of the frames that were looked at, rising; every other one is missing.
    """

    frame: IntArray
    position: FloatArray
    size_m: FloatArray
    core_share: FloatArray
    usable: IntArray

    @cached_property
    def place(self) -> IntArray:
        """(N,) places of the detections' frames among the usable ones."""
        return np.asarray(np.searchsorted(self.usable, self.frame))

    def missing(self, earlier: IntArray, later: int) -> IntArray:
        """Return how many frames are missing between some detections and a later one."""
        apart = self.frame[later] - self.frame[earlier]
        return np.asarray(apart - (self.place[later] - self.place[earlier]))


@dataclass
class _Track:
    number: int
    members: list[int] = field(default_factory=list)


def link(detections: Detections, settings: LinkingSettings, metric_scale: float = 1.0) -> IntArray:
    """Return the track number of each of N detections, numbered in order of first sighting."""
    labels = np.full(len(detections.frame), -1, dtype=np.int64)
    active: list[_Track] = []
    born = 0
    for frame in np.unique(detections.frame):
        free = np.flatnonzero(detections.frame == frame)
        place = detections.place[free[0]]
        active = [
            t
            for t in active
            if place - detections.place[t.members[-1]] <= settings.misses_frames + 1
        ]
        for tier, gate_m in _tiers(active, settings):
            free = _assign(detections, tier, free, gate_m, settings, metric_scale)
        for index in free:
            active.append(_Track(born, [int(index)]))
            born += 1
        for track in active:
            labels[track.members[-1]] = track.number
    return labels


def _tiers(active: list[_Track], settings: LinkingSettings) -> list[tuple[list[_Track], float]]:
    """Return who chooses in which order, and within which gate."""
    proven = [t for t in active if len(t.members) >= 3]
    young = [t for t in active if len(t.members) == 2]
    new = [t for t in active if len(t.members) == 1]
    return [
        (proven, settings.gate_m),
        (young, settings.gate_m),
        (new, settings.new_gate_m),
        (new, settings.fast_gate_m),
    ]


def _predict(detections: Detections, track: _Track, frame: int, frames_back: int) -> FloatArray:
    last = track.members[-1]
    first = track.members[max(0, len(track.members) - 1 - frames_back)]
    elapsed = detections.frame[last] - detections.frame[first]
    if elapsed == 0:
        return np.asarray(detections.position[last])
    velocity = (detections.position[last] - detections.position[first]) / elapsed
    ahead = frame - detections.frame[last]
    return np.asarray(detections.position[last] + velocity * ahead)


def _assign(
    detections: Detections,
    tracks: list[_Track],
    free: IntArray,
    gate_m: float,
    settings: LinkingSettings,
    metric_scale: float,
) -> IntArray:
    """Let tracks that have no sighting in this frame choose; return the detections left over."""
    from scipy.optimize import linear_sum_assignment

    if not len(free):
        return free
    frame = int(detections.frame[free[0]])
    tracks = [t for t in tracks if detections.frame[t.members[-1]] < frame]
    if not tracks:
        return free
    predicted = np.array([_predict(detections, t, frame, settings.velocity_frames) for t in tracks])
    last = np.array([t.members[-1] for t in tracks])
    gap = np.linalg.norm(predicted[:, None] - detections.position[free][None], axis=2)
    size = np.maximum(detections.size_m, 1e-3)
    size_gap = np.abs(np.log(size[free][None] / size[last][:, None]))
    gates = np.full(len(tracks), gate_m * metric_scale)
    seen_twice = np.array([len(t.members) >= 2 for t in tracks])
    grown = detections.missing(last, int(free[0])) * settings.gap_gate_m * metric_scale
    gates[seen_twice] += grown[seen_twice]
    cost = (
        gap / gates[:, None]
        + settings.size_cost * np.minimum(size_gap, 1.0)
        + settings.core_cost * (1 - detections.core_share[free])[None]
    )
    reachable = gap <= gates[:, None]
    # An unreachable pair costs more than any set of reachable ones, so that as many links as
    # possible are made and, among those, the cheapest.
    cost = np.where(reachable, cost, 10.0 * (1 + min(cost.shape)))
    rows, columns = linear_sum_assignment(cost)
    taken = [(r, c) for r, c in zip(rows, columns, strict=True) if reachable[r, c]]
    for r, c in taken:
        tracks[r].members.append(int(free[c]))
    kept = np.ones(len(free), dtype=bool)
    kept[[c for _, c in taken]] = False
    return free[kept]
