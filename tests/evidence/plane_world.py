"""A wall and a box before a camera, with exact flow: what the motion cues are tested on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from tcrdata.errors import FrameError
from tcrdata.geometry.transforms import as_tuples, inverse, transform_points
from tcrdata.store.arrays import encode_bits, encode_flow
from tcrdata.types import Camera, CueInput, Frame, PointCloud, Rows, SequenceInfo

WIDTH, HEIGHT, FOCAL = 160, 120, 100.0
PROJECTION = ((FOCAL, 0, 80, 0), (0, FOCAL, 60, 0), (0, 0, 1, 0))
BOX = (slice(40, 80), slice(60, 100))  # rows, columns of the moving box in the image
EVERYTHING_CONSISTENT = 3


class MemoryTables:
    """Rows in memory, read as the store reads them."""

    def __init__(self) -> None:
        self.rows: dict[str, list[dict[str, Any]]] = {}

    def add(self, batches: Iterable[Rows]) -> None:
        for batch in batches:
            names = list(batch.columns)
            for values in zip(*batch.columns.values(), strict=True):
                self.rows.setdefault(batch.table, []).append(dict(zip(names, values, strict=True)))

    def read(self, table: str, columns: Any = None, **equals: Any) -> pa.Table:
        found = [
            row
            for row in self.rows.get(table, [])
            if all(row.get(name) == value for name, value in equals.items())
        ]
        names = columns or sorted({name for row in found for name in row})
        return pa.table({name: [row.get(name) for row in found] for name in names})


@dataclass
class ArrayDataset:
    """Clouds and images in memory; a frame without a cloud cannot be read."""

    clouds: dict[int, PointCloud]
    images: dict[int, Any] = field(default_factory=dict)
    name: str = "plane"
    root: str = "plane"

    def read_points(self, frame: Frame) -> PointCloud:
        if frame.frame not in self.clouds:
            raise FrameError(f"frame {frame.frame}: no sweep")
        return self.clouds[frame.frame]

    def read_image(self, frame: Frame) -> Any:
        return self.images[frame.frame]


def frame(number: int, image_error: str | None = None) -> Frame:
    eye = as_tuples(np.eye(4))
    camera = Camera(PROJECTION, WIDTH, HEIGHT)
    return Frame("plane", "a", number, number * 10**8, camera, eye, eye, image_error=image_error)


def cue_input(
    dataset: Any, tables: MemoryTables, settings: Any, frames: Any, scale: float = 1.0
) -> CueInput:
    info = SequenceInfo("plane", "a", "plane", "lidar", scale, False, "none", "0", len(frames))
    return CueInput(info, tuple(frames), dataset, tables, settings, map)


def first_cloud(depth_m: float = 6.8, box_depth_m: float = 6.0) -> np.ndarray:
    """(H * W, 3) points, one a pixel: a wall with a step, and a box before it."""
    depth = np.full((HEIGHT, WIDTH), depth_m)
    depth[:, :30] += 2.0
    depth[:20] -= 1.0
    depth[BOX] = box_depth_m
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    xyz = np.stack([(columns - 80) / FOCAL * depth, (rows - 60) / FOCAL * depth, depth], axis=2)
    return xyz.reshape(-1, 3)


def motion(x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = [
        [np.cos(yaw), 0, np.sin(yaw)],
        [0, 1, 0],
        [-np.sin(yaw), 0, np.cos(yaw)],
    ]
    result[:3, 3] = (x, y, z)
    return result


def project(xyz: np.ndarray) -> np.ndarray:
    return xyz[:, :2] / xyz[:, 2:] * FOCAL + (80, 60)


def two_frames(
    to_T_from: np.ndarray, box_moves: tuple[float, float, float] = (0, 0, 0)
) -> tuple[ArrayDataset, MemoryTables, tuple[Frame, Frame]]:
    """Two frames whose points correspond, with exact flow both ways in the table `flows`."""
    before = first_cloud()
    stays = before.copy()
    in_box = np.zeros((HEIGHT, WIDTH), dtype=bool)
    in_box[BOX] = True
    stays[in_box.ravel()] += box_moves
    after = transform_points(to_T_from, stays)
    forward = (project(after) - project(before)).reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    tables = MemoryTables()
    tables.add(flow_rows(0, 1, forward, _seen_again(after) * EVERYTHING_CONSISTENT))
    tables.add(flow_rows(1, 0, _backward(before, after)))
    clouds = {0: _cloud(before), 1: _cloud(after)}
    return ArrayDataset(clouds), tables, (frame(0), frame(1))


def _far_to_near(after: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points that end inside the image, the farthest first, with their columns and rows."""
    pixels = np.floor(project(after) + 0.5).astype(int)
    inside = ((pixels >= 0) & (pixels < (WIDTH, HEIGHT))).all(axis=1)
    order = np.argsort(-after[:, 2], kind="stable")
    order = order[inside[order]]
    return order, *pixels[order].T


def _backward(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(H, W, 2): at the nearest point of each pixel of the second frame, its way back."""
    flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    order, columns, rows = _far_to_near(after)
    flow[rows, columns] = project(before)[order] - np.stack([columns, rows], axis=1)
    return flow


def _seen_again(after: np.ndarray) -> np.ndarray:
    """(H, W): pixels of the first frame whose point nothing nearer covers in the second."""
    depth = np.full((HEIGHT, WIDTH), np.inf)
    order, columns, rows = _far_to_near(after)
    depth[rows, columns] = after[order, 2]
    seen = np.zeros(HEIGHT * WIDTH, np.uint8)
    seen[order] = depth[rows, columns] > after[order, 2] - 0.1
    return seen.reshape(HEIGHT, WIDTH)


def flow_rows(
    start: int, end: int, flow: np.ndarray, planes: Any = EVERYTHING_CONSISTENT
) -> list[Rows]:
    codec, data = encode_flow(flow)
    row = {
        "frame": start,
        "frame_to": end,
        "direction": "forward" if end > start else "backward",
        "height_px": flow.shape[0],
        "width_px": flow.shape[1],
        "codec": codec,
        "data": data,
        "consistent": encode_bits(np.broadcast_to(np.uint8(planes), flow.shape[:2])),
    }
    return [Rows("flows", {name: [value] for name, value in row.items()})]


def egomotion_rows(to_T_from: np.ndarray, method: str = "flow_ransac") -> list[Rows]:
    row = {
        "frame": 0,
        "frame_to": 1,
        "method": method,
        "to_T_from": to_T_from.ravel().tolist(),
        "from_T_to": inverse(to_T_from).ravel().tolist(),
    }
    return [Rows("egomotions", {name: [value] for name, value in row.items()})]


def without_image(number: int) -> Frame:
    return replace(frame(number), image_error="no image")


def _cloud(xyz: np.ndarray) -> PointCloud:
    return PointCloud(xyz.astype(np.float32), np.zeros(len(xyz), np.float32))
