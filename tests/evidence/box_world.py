"""A bare world for tests: boxes seen on the sides that face a sensor that drives straight on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from tcrdata.geometry.boxes import l_shape_box
from tcrdata.geometry.transforms import as_tuples
from tcrdata.store.arrays import encode_points
from tcrdata.store.schemas import arrow_schema
from tcrdata.types import CueInput, Frame, PointCloud, SequenceInfo

GROUND_Y = 1.65


@dataclass(frozen=True)
class Thing:
    """A box in the world that stands or moves straight on."""

    x: float
    z: float
    length: float = 4.2
    width: float = 1.8
    height: float = 1.5
    yaw: float = 0.0
    speed: float = 0.0
    missed: tuple[int, ...] = ()

    def box(self, frame: int, own_speed: float) -> np.ndarray:
        """The (7,) box in the level frame of a frame."""
        way = 0.1 * frame * self.speed
        return np.array(
            [
                self.x + way * math.cos(self.yaw),
                GROUND_Y - self.height / 2,
                self.z - way * math.sin(self.yaw) - 0.1 * frame * own_speed,
                self.length,
                self.width,
                self.height,
                self.yaw,
            ]
        )


def shell(box: np.ndarray, rng: np.random.Generator, step: float = 0.12) -> np.ndarray:
    """Points on the sides of a level box that face the origin, 0.3 m above the ground upwards."""
    c, s = math.cos(box[6]), math.sin(box[6])
    axes = np.array([[c, -s], [s, c]])
    half = box[3:5] / 2
    sensor = axes @ -box[[0, 2]]
    sides = []
    for axis in range(2):
        if abs(sensor[axis]) > half[axis]:
            along = np.arange(-half[1 - axis], half[1 - axis] + 1e-6, step)
            up = np.arange(0.3, box[5] + 1e-6, 0.15)
            a, h = np.meshgrid(along, up)
            local = np.empty((a.size, 2))
            local[:, axis] = math.copysign(half[axis], sensor[axis])
            local[:, 1 - axis] = a.ravel()
            xz = box[[0, 2]] + local @ axes
            sides.append(np.stack([xz[:, 0], GROUND_Y - h.ravel(), xz[:, 1]], axis=1))
    points = np.concatenate(sides)
    return (points + rng.normal(0, 0.015, points.shape)).astype(np.float32)


@dataclass(frozen=True)
class BoxWorld:
    """The dataset; things that move get free votes, the others static ones."""

    things: tuple[Thing, ...]
    frames_count: int = 20
    own_speed: float = 0.0
    clutter: np.ndarray = field(default_factory=lambda: np.empty((0, 3), dtype=np.float32))
    name: str = "boxes"
    root: str = ""

    def parts(self, frame: int) -> list[np.ndarray]:
        """Points of each thing, then of the clutter."""
        parts = [
            np.empty((0, 3), dtype=np.float32)
            if frame in thing.missed
            else shell(thing.box(frame, self.own_speed), np.random.default_rng([frame, i]))
            for i, thing in enumerate(self.things)
        ]
        moved = self.clutter - np.array([0, 0, 0.1 * frame * self.own_speed])
        return [*parts, moved.astype(np.float32)]

    def read_points(self, frame: Frame) -> PointCloud:
        xyz = np.concatenate(self.parts(frame.frame))
        return PointCloud(xyz, np.zeros(len(xyz), dtype=np.float32))

    def frames(self) -> tuple[Frame, ...]:
        eye = as_tuples(np.eye(4))
        # The sensor looks along z: its x is forward, its z up.
        sensor = np.eye(4)
        sensor[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
        return tuple(
            Frame(self.name, "one", i, 10**8 * i, None, eye, as_tuples(sensor))
            for i in range(self.frames_count)
        )

    def cue(self, settings) -> CueInput:
        info = SequenceInfo(
            self.name, "one", "", "lidar", 1.0, False, "made up", "0", self.frames_count
        )
        return CueInput(
            info, self.frames(), self, _tables(self), settings, lambda f, items: map(f, items)
        )


class _Tables:
    def __init__(self, rows: dict[str, list[dict]]):
        self._rows = rows

    def read(self, table, columns=None, **equals):
        result = pa.Table.from_pylist(self._rows[table], schema=arrow_schema(table))
        for name, value in equals.items():
            result = result.filter(pc.equal(result[name], value))
        return result.select(list(columns)) if columns else result


def _tables(world: BoxWorld) -> _Tables:
    step = np.eye(4)
    step[2, 3] = -0.1 * world.own_speed
    key = {"dataset": world.name, "sequence": "one", "round": 1}
    rows: dict[str, list[dict]] = {"egomotions": [], "point_evidence": [], "proposals": []}
    for frame in range(world.frames_count):
        if frame + 1 < world.frames_count:
            motion = {"frame": frame, "frame_to": frame + 1, "to_T_from": step.ravel().tolist()}
            rows["egomotions"].append({**key, **motion, "method": "odometry"})
        rows["point_evidence"] += _evidence(world, frame, key)
        rows["proposals"] += _clusters(world, frame, key)
    return _Tables(rows)


def _evidence(world: BoxWorld, frame: int, key: dict) -> list[dict]:
    parts = world.parts(frame)
    moves = np.concatenate(
        [
            np.full(len(p), i < len(world.things) and world.things[i].speed > 0)
            for i, p in enumerate(parts)
        ]
    )
    values = {
        "ground": ("bits", np.zeros(len(moves), dtype=bool)),
        "votes_free": ("u8", np.where(moves, 8, 0).astype(np.uint8)),
        "votes_static": ("u8", np.where(moves, 0, 8).astype(np.uint8)),
        "height_m": ("f16", (GROUND_Y - np.concatenate(parts)[:, 1]).astype(np.float32)),
    }
    return [
        {
            **key,
            "frame": frame,
            "cue": cue,
            "codec": codec,
            "number_of_points": len(moves),
            "data": encode_points(array, codec),
        }
        for cue, (codec, array) in values.items()
    ]


def _clusters(world: BoxWorld, frame: int, key: dict) -> list[dict]:
    rows, first = [], 0
    for i, points in enumerate(world.parts(frame)[:-1]):
        if world.things[i].speed > 0 and len(points):
            fit = l_shape_box(points[:, [0, 2]])
            region = f"boxes/one/{frame:06d}/free_space/{i:03d}"
            rows.append(
                {
                    **key,
                    "frame": frame,
                    "source": "free_space",
                    "fit": "l_shape",
                    "proposal_id": f"{region}/l_shape",
                    "region_id": region,
                    "found": "observed",
                    "metric_scale": 1.0,
                    "x_m": fit.cx,
                    "y_m": 1.0,
                    "z_m": fit.cz,
                    "length_m": fit.length,
                    "width_m": fit.width,
                    "height_m": 1.2,
                    "yaw_rad": fit.yaw_rad,
                    "range_m": 1.0,
                    "number_of_points": len(points),
                    "point_indices": list(range(first, first + len(points))),
                    "bottom_above_ground_m": 0.3,
                    "top_above_ground_m": 1.5,
                    "core_points": len(points),
                    "core_share": 1.0,
                    "votes_free_mean": 8.0,
                    "votes_static_mean": 0.0,
                    "free_share": 1.0,
                }
            )
        first += len(points)
    return rows


def collected(batches, table: str) -> list[dict]:
    """Rows of one table that a cue yielded, as dictionaries."""
    rows = []
    for batch in batches:
        if batch.table == table:
            rows += [
                dict(zip(batch.columns, values, strict=True))
                for values in zip(*batch.columns.values(), strict=True)
            ]
    return rows
