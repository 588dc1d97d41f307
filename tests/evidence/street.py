"""A street for tests: a road, four walls, posts, a box that drives, and a coarse 64-beam sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa

from tcrdata.errors import FrameError
from tcrdata.geometry.transforms import as_tuples
from tcrdata.types import CueInput, Frame, PointCloud, Rows, SequenceInfo

SENSOR_HEIGHT_M = 1.73
LEVEL_T_SENSOR = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
WALLS = (
    (-12.0, 60.0, 1.0, 130.0),
    (12.0, 60.0, 1.0, 130.0),
    (0.0, 70.0, 26.0, 1.0),
    (0.0, -12.0, 26.0, 1.0),
)
POSTS = tuple((side * 9.0, z, 0.8, 0.8) for z in range(-8, 60, 12) for side in (-1, 1))


@dataclass(frozen=True)
class Street:
    """Points of a sensor that drives `step_m` a frame; the box drives across at `box_step_m`."""

    step_m: float = 0.5
    box_step_m: float = 0.6
    frames_count: int = 24
    broken: tuple[int, ...] = ()
    sparse: tuple[int, ...] = ()
    name: str = "street"
    root: str = "."

    def box(self, frame: int) -> tuple[float, float, float, float]:
        """Centre x, z and sizes along x and z of the box, level frame of the frame."""
        return -6.0 + self.box_step_m * frame, 18.0 - self.step_m * frame, 4.0, 2.0

    def read_points(self, frame: Frame) -> PointCloud:
        if frame.frame in self.broken:
            raise FrameError(f"frame {frame.frame}: the sweep is damaged: fetch it again")
        xyz = scan(self, frame.frame)
        if frame.frame in self.sparse:
            xyz = xyz[:5]
        return PointCloud(xyz, np.zeros(len(xyz), np.float32))


@lru_cache(maxsize=64)
def scan(street: Street, frame: int) -> np.ndarray:
    """(N, 3) float32 returns of one sweep."""
    rays = fan()
    shift = street.step_m * frame
    boxes = [(x, z - shift, sx, sz, 4.0) for x, z, sx, sz in (*WALLS, *POSTS)]
    boxes.append((*street.box(frame), 1.8))
    distance = np.min([hit(rays, *box) for box in boxes] + [road(rays)], axis=0)
    kept = distance < 100.0
    return (rays[kept] * distance[kept, None]).astype(np.float32)


@lru_cache(maxsize=1)
def fan() -> np.ndarray:
    """(N, 3) directions, level frame: 64 beams from 2 to -24.8 degrees, every half degree."""
    elevation = np.radians(np.linspace(2.0, -24.8, 64))[:, None]
    azimuth = np.radians(np.arange(0, 360, 0.5))[None]
    rays = [np.cos(elevation) * np.sin(azimuth), -np.sin(elevation) + 0 * azimuth]
    return np.stack([*rays, np.cos(elevation) * np.cos(azimuth)], axis=-1).reshape(-1, 3)


def road(rays: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.where(rays[:, 1] > 0, SENSOR_HEIGHT_M / rays[:, 1], np.inf)


def hit(rays: np.ndarray, x: float, z: float, sx: float, sz: float, height: float) -> np.ndarray:
    """Distances to an upright box on the road; infinite where a ray misses."""
    low = np.array([x - sx / 2, SENSOR_HEIGHT_M - height, z - sz / 2])
    high = np.array([x + sx / 2, SENSOR_HEIGHT_M, z + sz / 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = low / rays, high / rays
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return np.where((near <= far) & (near > 0), near, np.inf)


class FakeTables:
    """Tables over rows in memory."""

    def __init__(self) -> None:
        self.rows: dict[str, list[dict[str, Any]]] = {}

    def add(self, batch: Rows) -> None:
        names = list(batch.columns)
        for values in zip(*batch.columns.values(), strict=True):
            self.rows.setdefault(batch.table, []).append(dict(zip(names, values, strict=True)))

    def read(self, table: str, columns: Any = None, **equals: Any) -> pa.Table:
        rows = self.rows.get(table, [])
        rows = [r for r in rows if all(r[k] == v for k, v in equals.items())]
        names = columns or (list(rows[0]) if rows else [])
        return pa.table({name: [r.get(name) for r in rows] for name in names})


def street_frames(street: Street, numbers: range | None = None) -> tuple[Frame, ...]:
    return tuple(
        Frame(
            dataset="street",
            sequence="0000",
            frame=n,
            timestamp_ns=n * 100_000_000,
            camera=None,
            camera_T_level=as_tuples(np.eye(4)),
            level_T_sensor=as_tuples(LEVEL_T_SENSOR),
        )
        for n in numbers or range(street.frames_count)
    )


def measure(module: Any, street: Street, tables: FakeTables, **changes: Any) -> list[Rows]:
    """Run a cue over the street and keep its rows in the tables."""
    frames = changes.pop("frames", None) or street_frames(street)
    info = SequenceInfo("street", "0000", ".", "lidar", 1.0, False, "exact", "0" * 64, len(frames))
    settings = module.Settings(**changes)
    cue = CueInput(info, frames, street, tables, settings, _inline)
    batches = list(module.run(cue))
    for batch in batches:
        tables.add(batch)
    return batches


def _inline(function: Any, items: Any) -> Iterator[Any]:
    return map(function, items)
