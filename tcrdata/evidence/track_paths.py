"""Tracks through their frames: refine, look into every frame's box, fill, extend, refine again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.refinement import quantile
from tcrdata.evidence.sightings import RefinedPath, RefinementSettings, Sightings
from tcrdata.evidence.track_frames import BoxLook
from tcrdata.evidence.world import World
from tcrdata.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Track:
    """One linked object, before anything is refined.

    Attributes:
        number: in order of first sighting.
        rows: (n,) its clusters.
        frame: (n,) their frame numbers, rising.
    """

    number: int
    rows: IntArray
    frame: IntArray


@dataclass(frozen=True)
class Shape:
    """A refined track.

    Attributes:
        first: frame number of the path's first step.
        path: centres, headings and size from above.
        base_y: (N,) level of the ground below, world y, metres.
        height: metres.
    """

    first: int
    path: RefinedPath
    base_y: FloatArray
    height: float

    @property
    def last(self) -> int:
        """Frame number of the path's last step."""
        return self.first + len(self.path.center) - 1

    def box(self, frame: int) -> FloatArray:
        """Return the (7,) box of a frame in the world, on the path or beyond its ends."""
        if not self.first <= frame <= self.last:
            return self._box_beyond(frame - (self.first if frame < self.first else self.last))
        step = frame - self.first
        return self._box(self.path.center[step], float(self.path.yaw_rad[step]), self.base_y[step])

    def _box(self, center: FloatArray, yaw: float, base_y: float) -> FloatArray:
        size = (self.path.length, self.path.width, self.height)
        return np.array([center[0], base_y - self.height / 2, center[1], *size, yaw])

    def _box_beyond(self, steps: int) -> FloatArray:
        """Return the (7,) box some steps after the last (> 0) or before the first (< 0).

        Constant speed and turning rate of the last steps of the path.
        """
        path = self.path if steps > 0 else _reversed(self.path)
        reach = min(3, len(path.center) - 1)
        center, yaw = path.center[-1], float(path.yaw_rad[-1])
        base_y = float(self.base_y[-1 if steps > 0 else 0])
        if reach == 0:
            return self._box(center, yaw, base_y)
        velocity = (path.center[-1] - path.center[-1 - reach]) / reach
        rate = (yaw - float(path.yaw_rad[-1 - reach])) / reach
        for k in range(1, abs(steps) + 1):
            # The chord that gave the velocity is (reach + 1) / 2 steps old.
            turn = rate * (k + (reach - 1) / 2)
            c, s = np.cos(turn), np.sin(turn)
            center = center + np.array(
                [c * velocity[0] + s * velocity[1], -s * velocity[0] + c * velocity[1]]
            )
            yaw += rate
        return self._box(center, yaw, base_y)


def _reversed(path: RefinedPath) -> RefinedPath:
    return replace(path, center=path.center[::-1], yaw_rad=path.yaw_rad[::-1])


@dataclass(frozen=True)
class Sighting:
    """What one frame gives of one track.

    Attributes:
        frame: frame number.
        xyz: (N, 3) level points, N >= 1.
        above_ground_m: lowest point above the ground.
        hidden: (4,) edges not to be trusted.
        observed: a cluster was linked, so that its extents may set the size.
    """

    frame: int
    xyz: NDArray[np.float32]
    above_ground_m: float
    hidden: BoolArray
    observed: bool


@dataclass(frozen=True)
class Prepared:
    """Sightings of one track, ready to be refined.

    Attributes:
        first: frame number of the first.
        seen: in the world, from above.
        ground_y: (n,) level of the ground below, world y, metres.
        height_m: (n,) highest point above it.
    """

    first: int
    seen: Sightings
    ground_y: FloatArray
    height_m: FloatArray


def prepared(sightings: list[Sighting], world: World) -> Prepared:
    """Return sightings in rising order of frames, at least one observed, in the world."""
    first = sightings[0].frame
    moved = [world.point_to_world(s.frame, s.xyz.astype(np.float64)) for s in sightings]
    sensor = np.array([world.sensor(s.frame) for s in sightings])
    offsets = np.cumsum([0, *(len(m) for m in moved)])
    points = np.concatenate(moved)
    top = np.minimum.reduceat(points[:, 1], offsets[:-1])
    low = np.maximum.reduceat(points[:, 1], offsets[:-1])
    ground = low + np.array([s.above_ground_m for s in sightings])
    seen = Sightings(
        step=np.array([s.frame - first for s in sightings], dtype=np.int64),
        xz=np.ascontiguousarray(points[:, [0, 2]]),
        offsets=offsets,
        sensor=sensor[:, [0, 2]],
        distrusted=np.array([s.hidden for s in sightings]),
        counts_for_size=np.array([s.observed for s in sightings]),
        above_top_m=top - sensor[:, 1],
    )
    return Prepared(first, seen, ground, ground - top)


def shape_of(track: Prepared, path: RefinedPath, settings: RefinementSettings) -> Shape:
    """Return the track on its refined path, standing on the ground."""
    observed = track.seen.counts_for_size
    height = quantile(track.height_m[observed], settings.length_quantile)
    base = _median_filtered(track.ground_y[observed])
    base_y = np.interp(np.arange(len(path.center)), track.seen.step[observed], base)
    return Shape(track.first, path, base_y, max(height, settings.pad_m))


def _median_filtered(values: FloatArray, reach: int = 5) -> FloatArray:
    listed = values.tolist()
    return np.array([median(listed[max(0, i - reach) : i + reach + 1]) for i in range(len(listed))])


@dataclass(frozen=True)
class Place:
    """A box of a track in one frame, to be looked at.

    Attributes:
        frame: frame number.
        box: (7,) world.
        row: the cluster linked there, or -1.
        found: observed, gap or extended.
        trusted: near enough to a sighting to take part in the refinement.
    """

    frame: int
    box: FloatArray
    row: int
    found: str
    trusted: bool


def places_of(
    track: Track, shape: Shape, world: World, extend_frames: int, trusted_frames: int
) -> list[Place]:
    """Return the places of a track in rising order of frames: sightings, gaps, beyond its ends."""
    segment = world.poses.segment[int(track.frame[0])]
    rows = dict(zip(track.frame.tolist(), track.rows.tolist(), strict=True))
    places = []
    for frame in range(shape.first - extend_frames, shape.last + extend_frames + 1):
        if frame not in world.frames or world.poses.segment[frame] != segment:
            continue
        beyond = max(shape.first - frame, frame - shape.last, 0)
        found = "observed" if frame in rows else "extended" if beyond else "gap"
        row = rows.get(frame, -1)
        places.append(Place(frame, shape.box(frame), row, found, beyond <= trusted_frames))
    return places


def kept_places(
    places: list[Place], looks: list[BoxLook | None]
) -> tuple[list[Place], list[BoxLook]]:
    """Return the places that stay: sightings, gaps, and what extends them without a break.

    An extension ends at the first frame that cannot be read or shows too little of the box.
    """
    seen = [look is not None for look in looks]
    inner = [i for i, p in enumerate(places) if p.found == "observed"]
    low, high = inner[0], inner[-1]
    while low > 0 and seen[low - 1]:
        low -= 1
    while high < len(places) - 1 and seen[high + 1]:
        high += 1
    kept = [(p, k) for p, k in zip(places, looks, strict=True) if k is not None]
    bounds = places[low].frame, places[high].frame
    kept = [(p, k) for p, k in kept if bounds[0] <= p.frame <= bounds[1]]
    return [p for p, _ in kept], [k for _, k in kept]
