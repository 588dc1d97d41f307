"""What stands on a plane in a depth image: connected surfaces, and what they show of a shape.

A region's numbers are in two frames: its smallest rectangle from above, for boxes, and the line of
sight to it, for what is round: there a camera sees the whole width, and the front.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tcrdata.evidence.ground import Settings as PlaneSettings
from tcrdata.evidence.ground import ground_plane
from tcrdata.geometry.boxes import min_area_box
from tcrdata.types import BoolArray, FloatArray, IntArray

_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
# Left, right and lower neighbour of a pixel: row and column.
_SIDES = ((0, -1), (0, 1), (1, 0))


@dataclass(frozen=True)
class RegionSettings:
    """How regions are cut out; metres are multiplied by the sequence's metric scale.

    Attributes:
        above_m: what is higher above the plane is an object.
        gap_m: neighbouring pixels whose points are nearer than this are of one region.
        least_pixels: smaller regions are no rows; every rule asks for more.
        front_m: a neighbouring pixel that is this much nearer hides what is beside it.
        trim_share: share of the points left out at each end of a height.
        voxel_m: several cameras: points in neighbouring cubes of this side are of one region.
    """

    above_m: float = 0.15
    gap_m: float = 0.43
    least_pixels: int = 7
    front_m: float = 0.4
    trim_share: float = 0.02
    voxel_m: float = 0.17


@dataclass(frozen=True)
class Region:
    """One region of one frame.

    Attributes:
        frame: its number.
        pixels: how many it has.
        points: indices into the frame's points; fewer than the pixels where gaps were filled.
        rectangle: centre x and z, length, width (m), yaw (rad): the smallest from above.
        fill_share: area of the points' hull over the rectangle's.
        sight: yaw of the line of sight from above (rad).
        front_m: nearest point along the line of sight.
        sides_m: leftmost and rightmost point across it.
        hidden_sides: share of the left, right and lower outline with something nearer beside it.
        hidden_share: the same of all three; 0 where several cameras saw it.
        image_hidden_share: of the outline in this camera's image alone; 1 where none of it shows.
        heights_m: lowest and highest point above the plane.
        plane_y_m: the plane's y at the centre.
        box_px: left, top, right, bottom of this camera's pixels; None without any.
    """

    frame: int
    pixels: int
    points: NDArray[np.int32]
    rectangle: tuple[float, float, float, float, float]
    fill_share: float
    sight: float
    front_m: float
    sides_m: tuple[float, float]
    hidden_sides: tuple[float, float, float]
    hidden_share: float
    image_hidden_share: float
    heights_m: tuple[float, float]
    plane_y_m: float
    box_px: tuple[float, float, float, float] | None

    @property
    def width_m(self) -> float:
        """How wide it looks."""
        return self.sides_m[1] - self.sides_m[0]


def table_plane(points: FloatArray, settings: PlaneSettings) -> FloatArray | None:
    """Return (a, b, c) of the plane y = a x + b z + c below the objects; None with too few points.

    Args:
        points: (H, W, 3) level frame, NaN for gaps.
        settings: metres scaled.
    """
    known = points[np.isfinite(points[..., 0])]
    if len(known) < settings.minimum_points:
        return None
    return ground_plane(known.astype(np.float32), settings)


def cut_regions(
    frame: int,
    points: FloatArray,
    numbers: NDArray[np.int32],
    plane: FloatArray,
    settings: RegionSettings,
) -> list[Region]:
    """Return the regions of one camera's frame, the largest first.

    Args:
        frame: its number.
        points: (H, W, 3) level frame, whose origin is the camera's; NaN for gaps.
        numbers: (H, W) index of each pixel's point in the frame's points; -1 for gaps.
        plane: of the table.
        settings: metres scaled.
    """
    heights = _heights(points, plane)
    with np.errstate(invalid="ignore"):
        mask = heights > settings.above_m
    distance = np.nan_to_num(np.linalg.norm(points, axis=-1), nan=np.inf)
    regions = []
    for pixels in _components(points, mask, settings):
        own = points.reshape(-1, 3)[pixels]
        shape = _shape(frame, own, heights.ravel()[pixels], settings.trim_share)
        hidden, share = _hidden(pixels, distance, settings.front_m)
        seen = _in_image(shape, pixels, numbers, share)
        regions.append(replace(seen, hidden_sides=hidden, hidden_share=share))
    return regions


def fused_regions(
    frame: int,
    points: FloatArray,
    numbers: NDArray[np.int32],
    others: Sequence[FloatArray],
    plane: FloatArray,
    settings: RegionSettings,
) -> list[Region]:
    """Return the regions of what several cameras see at once, the largest first.

    Each is taken for seen from all sides: nothing of its outline is hidden.

    Args:
        frame: its number.
        points: (H, W, 3) level frame; NaN for gaps.
        numbers: (H, W) index of each pixel's point in the frame's points; -1 for gaps.
        others: (N, 3) points of each other camera, in the same level frame.
        plane: of the table.
        settings: metres scaled.
    """
    from scipy.ndimage import label

    own = points.reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(own[:, 0]))
    pixels = np.concatenate([known, *(np.full(len(other), -1) for other in others)])
    cloud = np.concatenate([own[known], *others])
    heights = _heights(cloud, plane)
    above = np.flatnonzero(heights > settings.above_m)
    if not len(above):
        return []
    cells = np.floor(cloud[above] / settings.voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    filled = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    filled[tuple(cells.T)] = True
    numbered, _ = label(filled, structure=np.ones((3, 3, 3)))
    distance = np.nan_to_num(np.linalg.norm(points, axis=-1), nan=np.inf)
    regions = []
    for group in _groups(above, numbered[tuple(cells.T)] - 1, settings.least_pixels):
        shape = _shape(frame, cloud[group], heights[group], settings.trim_share)
        mine = pixels[group][pixels[group] >= 0]
        if len(mine):
            _, share = _hidden(mine, distance, settings.front_m)
            shape = _in_image(shape, mine, numbers, share)
        regions.append(shape)
    return regions


def _in_image(
    region: Region, pixels: IntArray, numbers: NDArray[np.int32], hidden_share: float
) -> Region:
    """Return a region with what one camera's (N,) pixels of it show."""
    rows, columns = np.divmod(pixels, numbers.shape[1])
    index = numbers.ravel()[pixels]
    edges = (columns.min(), rows.min(), columns.max(), rows.max())
    left, top, right, bottom = map(float, edges)
    return replace(
        region,
        points=index[index >= 0],
        image_hidden_share=hidden_share,
        box_px=(left, top, right, bottom),
    )


def _heights(points: FloatArray, plane: FloatArray) -> FloatArray:
    a, b, c = plane
    heights: FloatArray = a * points[..., 0] + b * points[..., 2] + c - points[..., 1]
    return heights


def _components(
    points: FloatArray, mask: BoolArray, settings: RegionSettings
) -> Iterator[IntArray]:
    """Yield the flat pixels of each connected region, the largest first."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = mask.shape
    places = np.flatnonzero(mask)
    if not len(places):
        return
    number = np.full(mask.shape, -1)
    number.ravel()[places] = np.arange(len(places))
    starts, ends = [], []
    for down, right in _NEIGHBOURS:
        left = max(0, -right)
        one = (slice(0, rows - down), slice(left, columns - max(0, right)))
        other = (slice(down, rows), slice(left + right, columns - max(0, right) + right))
        near = mask[one] & mask[other]
        steps = points[one][near] - points[other][near]
        near[near] = np.einsum("ij,ij->i", steps, steps) < settings.gap_m**2
        starts.append(number[one][near])
        ends.append(number[other][near])
    start, end = np.concatenate(starts), np.concatenate(ends)
    graph = coo_matrix((np.ones(len(start), bool), (start, end)), shape=(len(places),) * 2)
    _, labels = connected_components(graph, directed=False)
    yield from _groups(places, labels.astype(np.int64), settings.least_pixels)


def _groups(places: IntArray, labels: IntArray, least: int) -> list[IntArray]:
    """Return the places of each label that has enough of them, the largest first."""
    order = np.argsort(labels, kind="stable")
    groups = np.split(places[order], np.cumsum(np.bincount(labels))[:-1])
    kept = [group for group in groups if len(group) >= least]
    return sorted(kept, key=lambda group: (-len(group), int(group[0])))


def _shape(frame: int, points: FloatArray, heights: FloatArray, trim_share: float) -> Region:
    """Return what (N, 3) points of one thing show, as if nothing hid a part of it."""
    xz = points[:, [0, 2]]
    box = min_area_box(xz)
    middle = xz.mean(axis=0)
    forward = middle / max(float(np.linalg.norm(middle)), 1e-9)
    across = np.array([forward[1], -forward[0]])
    along, beside = xz @ forward, xz @ across
    low, high = np.quantile(heights, [trim_share, 1 - trim_share])
    return Region(
        frame=frame,
        pixels=len(points),
        points=np.empty(0, np.int32),
        rectangle=(box.cx, box.cz, box.length, box.width, box.yaw_rad),
        fill_share=box.fill_share,
        sight=math.atan2(-forward[1], forward[0]),
        front_m=float(along.min()),
        sides_m=(float(beside.min()), float(beside.max())),
        hidden_sides=(0.0, 0.0, 0.0),
        hidden_share=0.0,
        image_hidden_share=1.0,
        heights_m=(float(low), float(high)),
        plane_y_m=float((points[:, 1] + heights).mean()),
        box_px=None,
    )


def _hidden(
    pixels: IntArray, distance: FloatArray, front_m: float
) -> tuple[tuple[float, float, float], float]:
    """Return the hidden shares of the left, right and lower outline, and of them together.

    An outline is hidden where the pixel beside it is nearer, or outside the image.
    """
    height, width = distance.shape
    inside = np.zeros((height + 2, width + 2), bool)
    rows, columns = np.divmod(pixels, width)
    inside[rows + 1, columns + 1] = True
    around = np.zeros((height + 2, width + 2))
    around[1:-1, 1:-1] = distance
    shares, hidden_edges, edges = [], 0, 0
    for down, right in _SIDES:
        beside = (rows + 1 + down, columns + 1 + right)
        edge = ~inside[beside]
        hidden = edge & (around[beside] < distance[rows, columns] - front_m)
        shares.append(float(hidden.sum() / max(edge.sum(), 1)))
        hidden_edges += int(hidden.sum())
        edges += int(edge.sum())
    return (shares[0], shares[1], shares[2]), hidden_edges / max(edges, 1)
