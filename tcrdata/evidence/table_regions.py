"""What stands on a plane in a depth image: connected surfaces, and what they show of a shape.

A region's numbers are in two frames: its smallest rectangle from above, for boxes, and the line of
sight to it, for what is round: there a camera sees the whole width, and the front.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
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
    """

    above_m: float = 0.15
    gap_m: float = 0.43
    least_pixels: int = 7
    front_m: float = 0.4
    trim_share: float = 0.02


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
        hidden_share: the same of all three.
        heights_m: lowest and highest point above the plane.
        plane_y_m: the plane's y at the centre.
        box_px: left, top, right, bottom of the pixels.
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
    heights_m: tuple[float, float]
    plane_y_m: float
    box_px: tuple[float, float, float, float]

    @property
    def width_m(self) -> float:
        """How wide it looks."""
        return self.sides_m[1] - self.sides_m[0]


def cut_regions(
    frame: int,
    depth: NDArray[np.floating],
    points: FloatArray,
    numbers: NDArray[np.int32],
    plane: PlaneSettings,
    settings: RegionSettings,
) -> list[Region]:
    """Return the regions of a frame, the largest first.

    Args:
        frame: its number.
        depth: (H, W) metres, 0 for gaps.
        points: (H, W, 3) level frame, whose origin is the camera's.
        numbers: (H, W) index of each pixel's point in the frame's points; -1 for gaps.
        plane: how the table is found, metres scaled.
        settings: metres scaled.
    """
    known = depth > 0
    if np.count_nonzero(known) < plane.minimum_points:
        return []
    a, b, c = ground_plane(points[known].astype(np.float32), plane)
    heights = a * points[..., 0] + b * points[..., 2] + c - points[..., 1]
    mask = known & (heights > settings.above_m)
    members = list(_components(points, mask, settings))
    regions = [_region(frame, pixels, depth, points, heights, settings) for pixels in members]
    own = [numbers.ravel()[pixels] for pixels in members]
    return [replace(r, points=n[n >= 0]) for r, n in zip(regions, own, strict=True)]


def _components(
    points: FloatArray, mask: BoolArray, settings: RegionSettings
) -> Iterator[IntArray]:
    """Yield the flat pixels of each connected region, the largest first."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = mask.shape
    places = np.flatnonzero(mask)
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
    order = np.argsort(labels, kind="stable")
    sizes = np.bincount(labels, minlength=0)
    groups = np.split(places[order], np.cumsum(sizes)[:-1]) if len(places) else []
    kept = [group for group in groups if len(group) >= settings.least_pixels]
    yield from sorted(kept, key=lambda group: (-len(group), int(group[0])))


def _region(
    frame: int,
    pixels: IntArray,
    depth: NDArray[np.floating],
    points: FloatArray,
    heights: FloatArray,
    settings: RegionSettings,
) -> Region:
    xz = points.reshape(-1, 3)[pixels][:, [0, 2]]
    own_heights = heights.ravel()[pixels]
    box = min_area_box(xz)
    middle = xz.mean(axis=0)
    forward = middle / max(float(np.linalg.norm(middle)), 1e-9)
    across = np.array([forward[1], -forward[0]])
    along, beside = xz @ forward, xz @ across
    low, high = np.quantile(own_heights, [settings.trim_share, 1 - settings.trim_share])
    hidden, share = _hidden(pixels, depth, settings.front_m)
    rows, columns = np.divmod(pixels, depth.shape[1])
    ground = points.reshape(-1, 3)[pixels][:, 1] + own_heights
    return Region(
        frame=frame,
        pixels=len(pixels),
        points=np.empty(0, np.int32),
        rectangle=(box.cx, box.cz, box.length, box.width, box.yaw_rad),
        fill_share=box.fill_share,
        sight=math.atan2(-forward[1], forward[0]),
        front_m=float(along.min()),
        sides_m=(float(beside.min()), float(beside.max())),
        hidden_sides=hidden,
        hidden_share=share,
        heights_m=(float(low), float(high)),
        plane_y_m=float(ground.mean()),
        box_px=(float(columns.min()), float(rows.min()), float(columns.max()), float(rows.max())),
    )


def _hidden(
    pixels: IntArray, depth: NDArray[np.floating], front_m: float
) -> tuple[tuple[float, float, float], float]:
    """Return the hidden shares of the left, right and lower outline, and of them together.

    An outline is hidden where the pixel beside it is nearer, or outside the image.
    """
    height, width = depth.shape
    inside = np.zeros((height + 2, width + 2), bool)
    rows, columns = np.divmod(pixels, width)
    inside[rows + 1, columns + 1] = True
    around = np.zeros((height + 2, width + 2))
    around[1:-1, 1:-1] = np.where(depth > 0, depth, np.inf)
    shares, hidden_edges, edges = [], 0, 0
    for down, right in _SIDES:
        beside = (rows + 1 + down, columns + 1 + right)
        edge = ~inside[beside]
        hidden = edge & (around[beside] < depth[rows, columns] - front_m)
        shares.append(float(hidden.sum() / max(edge.sum(), 1)))
        hidden_edges += int(hidden.sum())
        edges += int(edge.sum())
    return (shares[0], shares[1], shares[2]), hidden_edges / max(edges, 1)
