"""A window of sweeps laid over one another in the world, cut into objects that stand still."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.density import density_clusters
from tcrdata.geometry.boxes import box_coordinates, edge_distance, l_shape_box
from tcrdata.types import BoolArray, Float32Array, FloatArray, IntArray


@dataclass(frozen=True)
class MapSettings:
    """How objects are cut out; metres are multiplied by the metric scale.

    The limits on size and points only bound the work: every rule asks for more. `static_votes`
    shapes the map and decides nothing: with fewer votes, what moves smears into the objects that
    it passes; whether an object was seen through is a column (`track_core_share`) and a rule.

    Attributes:
        static_votes: points with fewer static votes are left out.
        reach_m: points farther from the sensor are left out.
        highest_m: points higher above the ground are left out: crowns, wires, walls.
        voxel_m: side of the cubes that keep one point each.
        base_m: points lower above the ground are left out: kerbs and grass join what they touch.
        eps_m: neighbours are this near; what is larger than a car is cut again by the next.
        whole_length_m: what is longer is larger than a car.
        whole_width_m: what is wider is larger than a car.
        minimum_neighbours: a core point of a cluster has so many, itself counted.
        minimum_voxels: smaller clusters are left out.
        longest_m: longer clusters are left out.
        shortest_m: and those shorter in length.
        lowest_m: and those lower.
        trim_share: share of the points beyond each side of the box: mirrors, aerials.
        fit_points: points that the heading is searched on.
    """

    static_votes: int = 3
    reach_m: float = 50.0
    highest_m: float = 3.0
    voxel_m: float = 0.1
    base_m: float = 0.3
    eps_m: tuple[float, ...] = (0.45, 0.3, 0.2)
    whole_length_m: float = 6.5
    whole_width_m: float = 2.6
    minimum_neighbours: int = 5
    minimum_voxels: int = 30
    longest_m: float = 9.0
    shortest_m: float = 2.0
    lowest_m: float = 0.8
    trim_share: float = 0.02
    fit_points: int = 1000

    def scaled(self, metric_scale: float) -> MapSettings:
        """Return the settings of a world whose road scene is `metric_scale` as large."""
        names = [n for n in self.__dataclass_fields__ if n.endswith("_m") and n != "eps_m"]
        lengths = {name: getattr(self, name) * metric_scale for name in names}
        return replace(self, eps_m=tuple(eps * metric_scale for eps in self.eps_m), **lengths)


@dataclass(frozen=True)
class StaticObject:
    """One cluster of a window.

    Attributes:
        box: (7,) world, standing on the ground.
        edge_share: share of its voxels near a side of the box, from above.
        fit_residual_m: mean distance of the voxels to the nearest side.
        fill_share: area of the voxels' hull over the box's.
        voxels: number of voxels.
    """

    box: FloatArray
    edge_share: float
    fit_residual_m: float
    fill_share: float
    voxels: int


def thin(points: Float32Array, voxel_m: float) -> Float32Array:
    """Return the first of (N, 3+) points in each cube, in the order of the cubes."""
    if not len(points):
        return points
    cells = np.floor(points[:, :3] / np.float32(voxel_m)).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1
    keys = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
    _, first = np.unique(keys, return_index=True)
    return points[first]


def map_points(
    xyz: Float32Array,
    height_m: NDArray[np.floating],
    votes_static: NDArray[np.integer],
    ground: BoolArray,
    sensor: FloatArray,
    settings: MapSettings,
) -> IntArray:
    """Return the indices of a frame's points that belong on the map."""
    distance = np.hypot(xyz[:, 0] - np.float32(sensor[0]), xyz[:, 2] - np.float32(sensor[2]))
    chosen: IntArray = np.flatnonzero(
        ~ground
        & (votes_static >= settings.static_votes)
        & (height_m >= settings.base_m)
        & (height_m <= settings.highest_m)
        & (distance <= settings.reach_m)
    )
    return chosen


def static_objects(
    points: Float32Array, settings: MapSettings, edge_margin_m: float
) -> list[StaticObject]:
    """Return the objects of a map, in the order of their first voxel.

    Args:
        points: (N, 4) world x, y, z and height above the ground, metres, thinned.
        settings: scaled to the world.
        edge_margin_m: a voxel this near a side lies on it.
    """
    everything = np.arange(len(points))
    return list(_cut(points, everything, 0, settings, edge_margin_m))


def _cut(
    points: Float32Array,
    members: IntArray,
    level: int,
    settings: MapSettings,
    edge_margin_m: float,
) -> Iterator[StaticObject]:
    """Yield the objects among some points; what is larger than a car is cut by a smaller eps."""
    clusters = density_clusters(
        points[members, :3],
        eps_m=settings.eps_m[level],
        vertical_share=1.0,
        minimum_neighbours=settings.minimum_neighbours,
        minimum_points=settings.minimum_voxels,
    )
    last = level == len(settings.eps_m) - 1
    for cluster in clusters:
        found = _fitted(points[members[cluster]].astype(np.float64), settings, edge_margin_m)
        if not last and (found is None or _oversized(found, settings)):
            yield from _cut(points, members[cluster], level + 1, settings, edge_margin_m)
        elif found is not None and not _beyond(found, settings):
            yield found


def _oversized(item: StaticObject, settings: MapSettings) -> bool:
    return bool(item.box[3] > settings.whole_length_m or item.box[4] > settings.whole_width_m)


def _beyond(item: StaticObject, settings: MapSettings) -> bool:
    length, height = item.box[3], item.box[5]
    within = settings.shortest_m <= length <= settings.longest_m
    return bool(not within or height < settings.lowest_m)


def _fitted(points: FloatArray, settings: MapSettings, edge_margin_m: float) -> StaticObject | None:
    """Return the object of one cluster; None when it is far too long."""
    xz = points[:, [0, 2]]
    if np.hypot(*np.ptp(xz, axis=0)) > 1.5 * settings.longest_m:
        return None
    step = max(1, len(xz) // settings.fit_points)
    rectangle = l_shape_box(xz[::step], settings.voxel_m / 2)
    box = np.array([rectangle.cx, 0, rectangle.cz, 1, 1, 1, rectangle.yaw_rad])
    local = box_coordinates(xz, box)
    low, high = np.quantile(local, [settings.trim_share, 1 - settings.trim_share], axis=0)
    middle, size = (low + high) / 2, high - low
    c, s = np.cos(box[6]), np.sin(box[6])
    box[0] += c * middle[0] + s * middle[1]
    box[2] += -s * middle[0] + c * middle[1]
    box[3], box[4] = size
    if size[1] > size[0]:
        box[3], box[4], box[6] = size[1], size[0], box[6] - np.pi / 2
    top = float(np.quantile(points[:, 3], 1 - settings.trim_share))
    base_y = float(np.median(points[:, 1] + points[:, 3]))
    box[1], box[5] = base_y - top / 2, top
    gaps = edge_distance(xz, box)
    return StaticObject(
        box=box,
        edge_share=float((gaps <= edge_margin_m).mean()),
        fit_residual_m=float(gaps.mean()),
        fill_share=rectangle.fill_share,
        voxels=len(points),
    )
