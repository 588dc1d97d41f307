"""Regions of a table followed over time, and boxes completed where something hides a part.

A region's own extent is trusted where little of its outline is hidden. A box's size is a high
quantile of the trusted ones around it in time. Where a part is hidden, the box has that size; its
place lies between trusted sightings before and after, else it is held by the sides that are seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tcrdata.evidence.linking import Detections, LinkingSettings, link
from tcrdata.evidence.table_regions import Region
from tcrdata.geometry.boxes import half_turn
from tcrdata.types import BoolArray, FloatArray


@dataclass(frozen=True)
class TrackSettings:
    """How regions are followed and completed; metres are multiplied by the metric scale.

    Attributes:
        linking: gates of the association.
        window_frames: trusted sightings this many frames before and after tell a size.
        size_quantile: of the trusted sizes in the window.
        clear_share: an outline with a smaller hidden share is trusted.
        side_share: a side of which this share is hidden is not where the object ends.
        lifted_m: an object whose lowest point is higher, and not hidden, does not stand.
    """

    linking: LinkingSettings = field(
        default_factory=lambda: LinkingSettings(
            gate_m=2.3, new_gate_m=2.3, fast_gate_m=2.6, core_cost=0.0, size_cost=0.5
        )
    )
    window_frames: int = 10
    size_quantile: float = 0.75
    clear_share: float = 0.06
    side_share: float = 0.2
    lifted_m: float = 0.86


@dataclass(frozen=True)
class TrackedRegion:
    """One region of a track, with its boxes.

    Attributes:
        region: what was seen.
        track: number of its track.
        box: (7,) as a box: a rectangle from above.
        disc: (7,) as what is round from above: a square around the circle, along the line of sight.
        clear: whether its own extent is trusted.
        whole_in_image: whether its pixels are trusted to show all of it.
        age_frames: sightings of the track.
        span_frames: from its first sighting to its last.
        fill_share: of the trusted sightings around; of its own when there is none.
        points: median number of pixels of the track's sightings.
    """

    region: Region
    track: int
    box: FloatArray
    disc: FloatArray
    clear: bool
    whole_in_image: bool
    age_frames: int
    span_frames: int
    fill_share: float
    points: float


def follow(
    regions: Sequence[Region], usable: Sequence[int], settings: TrackSettings, metric_scale: float
) -> list[TrackedRegion]:
    """Return every region with its track and boxes, in the order given.

    Args:
        regions: of a whole sequence, by frame.
        usable: numbers of the frames that could be read.
        settings: unscaled.
        metric_scale: of the sequence.
    """
    if not regions:
        return []
    detections = Detections(
        frame=np.array([region.frame for region in regions], dtype=np.int64),
        position=np.array([_disc_center(region, region.width_m) for region in regions]),
        size_m=np.array([region.width_m for region in regions]),
        core_share=np.ones(len(regions)),
        usable=np.array(usable, dtype=np.int64),
    )
    labels = link(detections, settings.linking, metric_scale)
    found: list[TrackedRegion | None] = [None] * len(regions)
    for number in range(int(labels.max()) + 1):
        members = np.flatnonzero(labels == number)
        track = _Track([regions[i] for i in members.tolist()], settings, metric_scale)
        for place, index in enumerate(members.tolist()):
            found[index] = track.completed(place, number)
    return [entry for entry in found if entry is not None]


class _Track:
    """One track's sightings, in order."""

    def __init__(self, regions: list[Region], settings: TrackSettings, metric_scale: float) -> None:
        self.regions = regions
        self.settings = settings
        self.scale = metric_scale
        self.frames = np.array([region.frame for region in regions])
        self.clear = np.array([region.hidden_share < settings.clear_share for region in regions])
        self.rectangles = np.array([region.rectangle for region in regions])
        self.widths = np.array([region.width_m for region in regions])
        self.fill = np.array([region.fill_share for region in regions])
        self.tops = np.array([region.heights_m[1] for region in regions])
        self.bottoms = np.array([self._bottom(region) for region in regions])
        self.points = float(np.median([region.pixels for region in regions]))

    def completed(self, place: int, number: int) -> TrackedRegion:
        """Return one sighting with its boxes."""
        region, near = self.regions[place], self._near(place)
        fill = float(np.median(self.fill[near])) if near.any() else region.fill_share
        low = self.bottoms[place]
        high = max(region.heights_m[1], low + 1e-3)
        if near.any() and not self.clear[place]:
            high = max(high, low + self._quantile(self.tops - self.bottoms, near))
        level = (region.plane_y_m - (low + high) / 2, high - low)
        return TrackedRegion(
            region=region,
            track=number,
            box=self._box(place, near, *level),
            disc=self._disc(place, near, *level),
            clear=bool(self.clear[place]),
            whole_in_image=region.image_hidden_share < self.settings.clear_share,
            age_frames=len(self.regions),
            span_frames=int(self.frames[-1] - self.frames[0] + 1),
            fill_share=fill,
            points=self.points,
        )

    def _near(self, place: int) -> BoolArray:
        """Trusted sightings within the window."""
        apart = np.abs(self.frames - self.frames[place])
        return np.asarray(self.clear & (apart <= self.settings.window_frames))

    def _quantile(self, values: FloatArray, chosen: BoolArray) -> float:
        return float(np.quantile(values[chosen], self.settings.size_quantile))

    def _bottom(self, region: Region) -> float:
        """Height of the object's bottom: the plane, unless it is lifted and seen to be."""
        lifted = region.heights_m[0] > self.settings.lifted_m * self.scale
        return region.heights_m[0] if lifted and self._ends(region, 2) else 0.0

    def _ends(self, region: Region, side: int) -> bool:
        """Whether the object is seen to end at a side: left, right or below."""
        return region.hidden_sides[side] < self.settings.side_share

    def _disc(self, place: int, near: BoolArray, y_m: float, height_m: float) -> FloatArray:
        region = self.regions[place]
        width = self._quantile(self.widths, near) if near.any() else region.width_m
        if not self.clear[place]:
            width = max(width, region.width_m)
        center = self._between(place, width) if not self.clear[place] else None
        if center is None:
            center = _disc_center(region, width, self._ends(region, 0), self._ends(region, 1))
        return np.array([center[0], y_m, center[1], width, width, height_m, region.sight])

    def _between(self, place: int, width: float) -> FloatArray | None:
        """The centre of a disc between trusted sightings before and after; None without."""
        trusted = np.flatnonzero(self._near(place))
        before, after = trusted[trusted < place], trusted[trusted > place]
        if not len(before) or not len(after):
            return None
        a, b = int(before[-1]), int(after[0])
        share = (self.frames[place] - self.frames[a]) / (self.frames[b] - self.frames[a])
        first, last = (_disc_center(self.regions[i], width) for i in (a, b))
        return np.asarray(first + share * (last - first))

    def _box(self, place: int, near: BoolArray, y_m: float, height_m: float) -> FloatArray:
        x, z, length, width, yaw = self.rectangles[place]
        if not self.clear[place] and near.any():
            x, z, length, width, yaw = self._completed_rectangle(place, near)
        return np.array([x, y_m, z, length, width, height_m, yaw])

    def _completed_rectangle(self, place: int, near: BoolArray) -> tuple[float, ...]:
        """A rectangle of the trusted size and heading, placed as the visible part says."""
        nearest = self._nearest(place, near)
        yaw = float(self.rectangles[nearest, 4])
        length = max(self._quantile(self.rectangles[:, 2], near), 1e-3)
        width = max(self._quantile(self.rectangles[:, 3], near), 1e-3)
        before = np.flatnonzero(near[:place])
        after = np.flatnonzero(near[place + 1 :]) + place + 1
        if len(before) and len(after):
            a, b = int(before[-1]), int(after[0])
            share = (self.frames[place] - self.frames[a]) / (self.frames[b] - self.frames[a])
            turn = half_turn(float(self.rectangles[b, 4] - self.rectangles[a, 4]))
            center = self.rectangles[a, :2] + share * (
                self.rectangles[b, :2] - self.rectangles[a, :2]
            )
            if abs(turn) < math.pi / 8:
                yaw = float(self.rectangles[a, 4]) + share * turn
            return float(center[0]), float(center[1]), length, width, yaw
        reach = length, width
        center = self._held(self.regions[place], self.regions[nearest], reach)
        return float(center[0]), float(center[1]), length, width, yaw

    def _held(self, region: Region, trusted: Region, reach: tuple[float, float]) -> FloatArray:
        """The centre of a box: moved from a trusted sighting as the sides that are seen moved."""
        forward, across = _axes(region.sight)
        shifts = [
            region.sides_m[side] - trusted.sides_m[side]
            for side in (0, 1)
            if self._ends(region, side)
        ]
        sideways = float(np.mean(shifts)) if shifts else 0.0
        onward = region.front_m - trusted.front_m if self._ends(region, 2) else 0.0
        if max(abs(sideways), abs(onward)) > max(reach):
            return np.array(region.rectangle[:2])
        return np.array(trusted.rectangle[:2]) + sideways * across + onward * forward

    def _nearest(self, place: int, near: BoolArray) -> int:
        """The trusted sighting nearest in time."""
        apart = np.where(near, np.abs(self.frames - self.frames[place]), np.iinfo(np.int64).max)
        return int(apart.argmin())


def _axes(sight: float) -> tuple[FloatArray, FloatArray]:
    """Unit vectors in (x, z) along a line of sight and to its right."""
    forward = np.array([math.cos(sight), -math.sin(sight)])
    return forward, np.array([forward[1], -forward[0]])


def _disc_center(
    region: Region, width_m: float, left_ends: bool = True, right_ends: bool = True
) -> FloatArray:
    """The centre (x, z) of a circle: half its width behind its front, held by the sides seen."""
    forward, across = _axes(region.sight)
    left, right = region.sides_m
    middle = (left + right) / 2
    if left_ends and not right_ends:
        middle = left + width_m / 2
    elif right_ends and not left_ends:
        middle = right - width_m / 2
    return np.asarray(forward * (region.front_m + width_m / 2) + across * middle)
