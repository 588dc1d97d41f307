"""Blocks on a floor before a pinhole sensor, cast exactly: what trackers see, without files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tcrdata.tracking.cell_points import cell_points
from tcrdata.tracking.scenes import Candidates, Scene, from_box

FLOOR_M = 2.0
WIDTH, HEIGHT, FOCAL = 160, 90, 120.0


class BlockView:
    """Rays from the origin, z forward, y down, to blocks and the floor."""

    def __init__(self, boxes: np.ndarray) -> None:
        self.boxes = boxes
        self.origin = np.zeros(3)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ranges = np.linalg.norm(points, axis=1)
        rays = points / np.maximum(ranges, 1e-9)[:, None]
        u, v = (FOCAL * points[:, i] / np.maximum(points[:, 2], 1e-9) for i in (0, 1))
        inside = (points[:, 2] > 0) & (abs(u) <= WIDTH / 2) & (abs(v) <= HEIGHT / 2)
        return ranges, np.where(inside, self.cast(rays)[0], np.nan)

    def cast(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ranges of the first hits, and the block hit, -1 for the floor or nothing."""
        with np.errstate(divide="ignore"):
            best = np.where(rays[:, 1] > 1e-9, FLOOR_M / rays[:, 1], np.inf)
        owner = np.full(len(rays), -1)
        for number, box in enumerate(self.boxes):
            start = to_box(self.origin[None], box)[0]
            way = to_box(rays, box) - start
            way = np.where(abs(way) < 1e-9, 1e-9, way)
            half = box[[3, 5, 4]] / 2
            near, far = (-half - start) / way, (half - start) / way
            enter = np.minimum(near, far).max(axis=1)
            leave = np.maximum(near, far).min(axis=1)
            hit = (enter > 0) & (enter < leave) & (enter < best)
            best, owner = np.where(hit, enter, best), np.where(hit, number, owner)
        return best, owner


def to_box(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(N, 3) points from a box's centre along its length, down, and its width."""
    c, s = np.cos(box[6]), np.sin(box[6])
    dx, dz = points[:, 0] - box[0], points[:, 2] - box[2]
    return np.column_stack([c * dx - s * dz, points[:, 1] - box[1], s * dx + c * dz])


def block(x: float, z: float, size: tuple[float, float, float] = (1.2, 1.0, 1.4), yaw: float = 0):
    """A (7,) box that stands on the floor."""
    return np.array([x, FLOOR_M - size[2] / 2, z, *size, yaw])


def scene(
    frame: int,
    boxes: Mapping[str, np.ndarray],
    found: tuple[str, ...] = (),
    least_px: int = 12,
) -> Scene:
    """What a frame shows of named blocks.

    Args:
        frame: its number.
        boxes: name to (7,) box.
        found: names of those that are candidates, when they show enough.
        least_px: fewer pixels are no candidate.
    """
    view = BlockView(np.array(list(boxes.values())).reshape(-1, 7))
    columns, rows = np.meshgrid(
        np.arange(WIDTH) - WIDTH / 2 + 0.5, np.arange(HEIGHT) - HEIGHT / 2 + 0.5
    )
    rays = np.stack([columns / FOCAL, rows / FOCAL, np.ones_like(columns)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    ranges, owner = view.cast(rays)
    seen = owner >= 0
    points = (rays[seen] * ranges[seen, None]).astype(np.float32)
    colour = np.stack([np.cos(owner[seen] * 2.0), np.sin(owner[seen] * 2.0)], axis=1)
    features = np.column_stack([np.ones(len(points)), colour]).astype(np.float32) / np.sqrt(2)
    names = list(boxes)
    taken = [n for n in found if n in boxes and (owner == names.index(n)).sum() >= least_px]
    return Scene(
        frame,
        cell_points(points),
        features.astype(np.float32),
        Candidates(
            np.array([boxes[n] for n in taken]).reshape(-1, 7),
            np.ones(len(taken)),
            np.ones(len(taken), dtype=bool),
            (None,) * len(taken),
        ),
        view,
    )


def passing(frame: int, *, speed: float = 0.25) -> dict[str, np.ndarray]:
    """A block that goes from left to right behind a wall, and another that stands."""
    return {
        "mover": block(-5.0 + speed * frame, 12.0),
        "wall": block(0.0, 9.0, (2.6, 0.6, 2.2)),
        "still": block(4.5, 10.0, yaw=0.4),
    }


def corners_agree(a: np.ndarray, b: np.ndarray, atol: float) -> None:
    """Two boxes have the same corners."""
    unit = np.array([[u, v, w] for u in (-0.5, 0.5) for v in (-0.5, 0.5) for w in (-0.5, 0.5)])
    np.testing.assert_allclose(from_box(unit, a), from_box(unit, b), atol=atol)
