"""A generated drive in KITTI's geometry: a 64-beam LiDAR and a camera on a car; needs no files.

The own car follows a gently bent road between houses, trees and parked cars and meets moving cars,
a cyclist and a pedestrian. All of it is a pure function of the spec and the frame. Egomotion,
boxes, speeds and flow are known exactly, at whatever speed the spec asks for.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tcrdata.datasets.scene import View
from tcrdata.datasets.shading import inspect_hits, render
from tcrdata.datasets.specs import Limits, format_spec, parse_spec
from tcrdata.datasets.streetscape import (
    FRAMES_PER_SECOND,
    LANE_M,
    SUN,
    Plan,
    Street,
    build_street,
)
from tcrdata.datasets.truth import exact_flow, truth_rows
from tcrdata.errors import DatasetError, FrameError
from tcrdata.geometry.raycasting import cast
from tcrdata.geometry.transforms import as_tuples, transform_points
from tcrdata.types import (
    Camera,
    Float32Array,
    FloatArray,
    Frame,
    ImageArray,
    PointCloud,
    SequenceInfo,
)

VERSION = 1
CAMERA = Camera(
    projection=(
        (721.5377, 0.0, 609.5593, 0.0),
        (0.0, 721.5377, 172.854, 0.0),
        (0.0, 0.0, 1.0, 0.0),
    ),
    width_px=1242,
    height_px=375,
)
CAMERA_HEIGHT_M = 1.65
# Of the LiDAR in the level frame: 8 cm above and 27 cm behind the camera, turned by 0.4 degrees.
SENSOR_PLACE_M = (-0.004, -0.076, -0.272)
SENSOR_TURN_RAD = 0.0075
COLUMNS = 2000
MIN_RANGE_M, MAX_RANGE_M = 0.9, 100.0


@dataclass(frozen=True)
class StreetSpec:
    """Names a drive.

    Attributes:
        seed: of everything that is drawn.
        frames: of the drive, ten a second.
        speed_mps: of the own car.
        parked: number of parked cars.
        moving: number of moving road users.
        images: whether there is a camera.
        noise_m: standard deviation of a range.
        dropout: share of returns that are lost.
    """

    seed: int = 0
    frames: int = 50
    speed_mps: float = 8.0
    parked: int = 6
    moving: int = 4
    images: bool = True
    noise_m: float = 0.02
    dropout: float = 0.03


LIMITS = {
    "seed": Limits(0, 2**31 - 1),
    "frames": Limits(1, 10_000),
    "speed_mps": Limits(0.0, 40.0),
    "parked": Limits(0, 200),
    "moving": Limits(0, 50),
    "noise_m": Limits(0.0, 1.0),
    "dropout": Limits(0.0, 1.0),
}


def open_dataset(root: str | None = None) -> StreetDrive:
    """Open a drive; `root` names it, such as `seed=3,frames=50,speed_mps=8,images=false`.

    Raises:
        DatasetError: when the spec is malformed.
    """
    spec = parse_spec("street", root, StreetSpec(), LIMITS)
    return StreetDrive(name="street", root=format_spec(spec), spec=spec)


@dataclass(frozen=True)
class StreetDrive:
    """The generated drive; see `tcrdata.types.Dataset` for the protocol.

    Attributes:
        name: `street`.
        root: the spec, every value written out.
        spec: the spec.
    """

    name: str
    root: str
    spec: StreetSpec

    def sequences(self) -> list[str]:
        """The one drive."""
        return ["drive_0000"]

    def info(self, sequence: str) -> SequenceInfo:
        """The drive's row; raises DatasetError for an unknown name."""
        self._check(sequence)
        text = f"street version {VERSION}: {self.root}: {sequence}"
        return SequenceInfo(
            dataset=self.name,
            sequence=sequence,
            root=self.root,
            sensor="lidar",
            metric_scale=1.0,
            static_camera=False,
            calibration="generated",
            fingerprint=hashlib.sha256(text.encode()).hexdigest(),
            number_of_frames=self.spec.frames,
        )

    def frames(self, sequence: str) -> list[Frame]:
        """Every frame in order, ten a second."""
        self._check(sequence)
        return [
            Frame(
                dataset=self.name,
                sequence=sequence,
                frame=number,
                timestamp_ns=number * 1_000_000_000 // FRAMES_PER_SECOND,
                camera=CAMERA if self.spec.images else None,
                camera_T_level=as_tuples(np.eye(4)),
                level_T_sensor=as_tuples(_sensor_pose()),
            )
            for number in range(self.spec.frames)
        ]

    def read_points(self, frame: Frame) -> PointCloud:
        """Cast one sweep: 64 beams, beam by beam from the top, as one instant."""
        street, view = self._street(), self.view(frame.frame)
        world_T_level = np.linalg.inv(view.level_T_world)
        world_T_sensor = world_T_level @ _sensor_pose()
        origin, rays = world_T_sensor[:3, 3], _beams()
        directions = rays @ world_T_sensor[:3, :3].T
        primitives = street.scene.primitives(_time(frame.frame))
        ranges, hits = cast(primitives, origin, directions, MAX_RANGE_M)
        brightness, cosines = inspect_hits(
            primitives, street.scene.materials(), origin, directions, ranges, hits
        )
        random = np.random.default_rng([self.spec.seed, 11, frame.frame])
        noisy = ranges + self.spec.noise_m * random.standard_normal(len(ranges))
        # Surfaces seen at a very flat angle send little back.
        lost = random.random(len(ranges)) < self.spec.dropout + 0.5 * np.exp(-60.0 * cosines)
        kept = np.flatnonzero((hits >= 0) & (noisy >= MIN_RANGE_M) & (noisy <= MAX_RANGE_M) & ~lost)
        points = transform_points(_sensor_pose(), rays[kept] * noisy[kept, None])
        reflectance = np.clip(brightness[kept] * (0.3 + 0.7 * cosines[kept]), 0.0, 1.0)
        return PointCloud(points.astype(np.float32), reflectance.astype(np.float32))

    def read_image(self, frame: Frame) -> ImageArray:
        """The frame's (375, 1242, 3) RGB image; raises FrameError when the spec has no images."""
        if not self.spec.images:
            raise FrameError(
                f"frame {frame.frame} of {frame.sequence}: the drive {self.root!r} has no images; "
                "open it with images=true"
            )
        street, view = self._street(), self.view(frame.frame)
        return render(
            street.scene.primitives(_time(frame.frame)),
            street.scene.materials(),
            SUN,
            view.origin,
            view.pixel_rays,
            (CAMERA.width_px, CAMERA.height_px),
            samples=1,
        )

    def ground_truth(self, sequence: str) -> list[dict[str, Any]]:
        """A row for every object and frame in which it is in the image, hidden or not."""
        self._check(sequence)
        scene = self._street().scene
        return [
            {"dataset": self.name, "sequence": sequence, "round": 1, **row}
            for number in range(self.spec.frames)
            for row in truth_rows(scene, self.view(number), _time(number), number)
            if row["left_px"] is not None
        ]

    def view(self, number: int) -> View:
        """Return the camera at a frame; with it, the exact egomotion: truth, for scoring alone."""
        along = self.spec.speed_mps * _time(number)
        world_T_car = self._street().road.pose(along, -LANE_M)
        car_T_level = np.array(
            [[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, CAMERA_HEIGHT_M], [0, 0, 0, 1]], dtype=float
        )
        return View(CAMERA, np.eye(4), np.linalg.inv(world_T_car @ car_T_level))

    def exact_flow(self, frame: Frame, frame_to: Frame) -> Float32Array:
        """Return the true (H, W, 2) flow in pixels between two frames; NaN in the sky: truth."""
        return exact_flow(
            self._street().scene,
            self.view(frame.frame),
            _time(frame.frame),
            self.view(frame_to.frame),
            _time(frame_to.frame),
        )

    def exact_egomotion(self, frame: Frame, frame_to: Frame) -> FloatArray:
        """Return `level_to_T_level` (4, 4), from one frame's level frame to another's: truth."""
        motion: FloatArray = self.view(frame_to.frame).level_T_world @ np.linalg.inv(
            self.view(frame.frame).level_T_world
        )
        return motion

    def _street(self) -> Street:
        return _build(
            Plan(
                seed=self.spec.seed,
                duration_s=self.spec.frames / FRAMES_PER_SECOND,
                speed_mps=self.spec.speed_mps,
                parked=self.spec.parked,
                moving=self.spec.moving,
            )
        )

    def _check(self, sequence: str) -> None:
        if sequence not in self.sequences():
            raise DatasetError(
                f"the street dataset has no sequence {sequence!r}; it has {self.sequences()[0]}"
            )


@lru_cache(maxsize=8)
def _build(plan: Plan) -> Street:
    return build_street(plan)


def _time(frame: int) -> float:
    return frame / FRAMES_PER_SECOND


def _sensor_pose() -> FloatArray:
    c, s = math.cos(SENSOR_TURN_RAD), math.sin(SENSOR_TURN_RAD)
    matrix = np.eye(4)
    matrix[:3, :3] = [[s, -c, 0.0], [0.0, 0.0, -1.0], [c, s, 0.0]]
    matrix[:3, 3] = SENSOR_PLACE_M
    return matrix


@lru_cache(maxsize=1)
def _beams() -> FloatArray:
    """(64 * COLUMNS, 3) unit directions in the sensor's frame.

    The upper 32 beams go down from 2 degrees in steps of 1/3, the lower 32 in steps of 1/2.
    """
    upper = 2.0 - np.arange(32) / 3.0
    lower = upper[-1] - 0.5 * np.arange(1, 33)
    pitch = np.radians(np.concatenate([upper, lower]))[:, None]
    turn = np.pi - 2.0 * np.pi * np.arange(COLUMNS)[None] / COLUMNS
    directions = [
        np.cos(pitch) * np.cos(turn),
        np.cos(pitch) * np.sin(turn),
        np.repeat(np.sin(pitch), COLUMNS, axis=1),
    ]
    return np.stack(directions, axis=-1).reshape(-1, 3)
