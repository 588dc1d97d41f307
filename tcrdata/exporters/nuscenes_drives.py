"""A drive in nuScenes' tables: log, scenes, samples, ego poses, sensors and their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.exporters.cameras import camera_poses
from tcrdata.exporters.frame_images import FrameImages
from tcrdata.exporters.frame_points import FramePoints, lidar_poses
from tcrdata.exporters.global_frames import (
    EGO_T_LEVEL,
    chained_poses,
    quaternions,
    split_projection,
)
from tcrdata.exporters.labels import SequenceLabels
from tcrdata.exporters.nuscenes_tables import CAMERA, LIDAR, Tables, token
from tcrdata.geometry.transforms import inverse
from tcrdata.store.table_arrays import matrices, rows_at, whole_numbers
from tcrdata.types import FloatArray

_FULL_INTENSITY = 255.0
_POINTS = ".pcd.bin"


class Drive:
    """The frames of one sequence as samples of scenes.

    Attributes:
        part: the sequence.
        scenes: (F,) number of the scene of each frame, from 1.
        links: rows of `exported_scenes.sql` that have a label, in the order of the labels.
        samples: token of each frame's sample.
        global_T_ego: (F, 4, 4) poses; each scene has a global frame of its own.
    """

    def __init__(self, part: SequenceLabels) -> None:
        assert part.beside is not None
        rows = part.beside
        frames = whole_numbers(rows["frame"])
        first = np.flatnonzero(np.diff(frames, prepend=frames[0] - 1))
        begun = rows_at(rows, first)
        self.part = part
        self.scenes = whole_numbers(begun["scene"])
        self.links = rows.filter(rows["proposal_id"].is_valid())
        self.global_T_ego = chained_poses(begun["step"].to_pylist())
        self._numbers: list[int] = part.frames["frame"].to_pylist()
        self.samples = [self.key("sample", number) for number in self._numbers]
        self._times = [time // 1000 for time in part.frames["timestamp_ns"].to_pylist()]

    def key(self, kind: str, *what: object) -> str:
        """Return the token of something in this sequence."""
        return token(kind, self.part.dataset, self.part.sequence, *what)

    def write(self, tables: Tables, sensors: Sensors) -> str:
        """Write the drive without its labels; returns the token of its log."""
        log = self.key("log")
        day = datetime.fromtimestamp(self._times[0] / 1e6, UTC).date().isoformat()
        tables["log"].extend(
            [
                {
                    "token": log,
                    "logfile": self.part.sequence,
                    "vehicle": self.part.dataset,
                    "date_captured": day,
                    "location": self.part.dataset,
                }
            ]
        )
        tables["ego_pose"].extend(self._ego_poses())
        cameras, lidars = sensors.of(self.part, tables)
        edges = np.flatnonzero(np.diff(self.scenes, prepend=0, append=self.scenes[-1] + 1))
        for start, end in pairwise(edges.tolist()):
            rows = list(range(start, end))
            tables["scene"].extend([self._scene(rows, log)])
            tables["sample"].extend(self._samples(rows))
            for found in (cameras, lidars):
                tables["sample_data"].extend(self._sample_data(rows, found))
        return log

    def _scene(self, rows: list[int], log: str) -> dict[str, Any]:
        number = int(self.scenes[rows[0]])
        numbers = f"frames {self._numbers[rows[0]]} to {self._numbers[rows[-1]]}"
        return {
            "token": self.key("scene", number),
            "name": self.part.sequence + (f"-{number}" if number > 1 else ""),
            "description": f"{self.part.dataset} {self.part.sequence}, {numbers}",
            "log_token": log,
            "nbr_samples": len(rows),
            "first_sample_token": self.samples[rows[0]],
            "last_sample_token": self.samples[rows[-1]],
        }

    def _samples(self, rows: list[int]) -> Iterator[dict[str, Any]]:
        tokens = ["", *(self.samples[row] for row in rows), ""]
        scene = self.key("scene", int(self.scenes[rows[0]]))
        for place, row in enumerate(rows, 1):
            yield {
                "token": tokens[place],
                "timestamp": self._times[row],
                "scene_token": scene,
                "prev": tokens[place - 1],
                "next": tokens[place + 1],
            }

    def _sample_data(self, rows: list[int], found: SensorFrames) -> Iterator[dict[str, Any]]:
        there = [row for row in rows if found.names[row] is not None]
        keys = [self.key("sample_data", found.channel, self._numbers[row]) for row in there]
        tokens = ["", *keys, ""]
        for place, row in enumerate(there, 1):
            name = f"samples/{found.channel}/{found.names[row]}"
            width, height = found.sizes[row]
            yield {
                "token": tokens[place],
                "sample_token": self.samples[row],
                "ego_pose_token": self.key("ego_pose", self._numbers[row]),
                "calibrated_sensor_token": found.calibrations[row],
                "filename": name,
                "fileformat": name.rpartition("/")[2].split(".")[1],
                "width": width,
                "height": height,
                "timestamp": self._times[row],
                "is_key_frame": True,
                "prev": tokens[place - 1],
                "next": tokens[place + 1],
            }

    def _ego_poses(self) -> Iterator[dict[str, Any]]:
        turns = quaternions(self.global_T_ego[:, :3, :3]).tolist()
        places = self.global_T_ego[:, :3, 3].tolist()
        for row, number in enumerate(self._numbers):
            yield {
                "token": self.key("ego_pose", number),
                "timestamp": self._times[row],
                "rotation": turns[row],
                "translation": places[row],
            }


class SensorFrames:
    """What one sensor recorded in a sequence, a list entry a frame.

    Attributes:
        channel: `CAM_FRONT` or `LIDAR_TOP`.
        names: file below the channel's folder; None for a frame without.
        calibrations: tokens of the sensor's calibration.
        sizes: width and height in pixels; 0 for points.
    """

    def __init__(
        self,
        channel: str,
        names: list[str | None],
        calibrations: list[str],
        sizes: list[tuple[int, int]],
    ) -> None:
        self.channel, self.names = channel, names
        self.calibrations, self.sizes = calibrations, sizes


class Sensors:
    """Writes each calibration once, and the files of the sensors' frames.

    Attributes:
        files: images and point files made.
    """

    def __init__(self, folder: Path | None) -> None:
        """Take the folder of the export, or None to make no files."""
        self._folder = folder
        self._known: set[str] = set()
        self.files = 0

    def of(self, part: SequenceLabels, tables: Tables) -> tuple[SensorFrames, SensorFrames]:
        """Write what is new of a sequence; returns the frames of its camera and its LiDAR."""
        return self._cameras(part, tables), self._lidars(part, tables)

    def _cameras(self, part: SequenceLabels, tables: Tables) -> SensorFrames:
        files = FrameImages(part)
        there = [files.has_image(row) for row in range(part.frames.num_rows)]
        names = [files.name(row) if has else None for row, has in enumerate(there)]
        projections, poses = matrices(part.frames, "projection", (3, 4)), camera_poses(part)

        def place(row: int) -> tuple[FloatArray, FloatArray]:
            intrinsic, pinhole_T_camera = split_projection(projections[row])
            ego_T_camera = EGO_T_LEVEL @ inverse(poses[row])
            return ego_T_camera @ inverse(pinhole_T_camera), intrinsic

        numbers = np.concatenate([projections, poses], axis=1)
        tokens = self._calibrated(CAMERA, numbers, there, place, tables)
        if self._folder is not None:
            self.files += files.place_all(self._folder / "samples" / CAMERA)
        sizes = zip(*(part.frames[n].to_pylist() for n in ("width_px", "height_px")), strict=True)
        return SensorFrames(CAMERA, names, tokens, list(sizes))

    def _lidars(self, part: SequenceLabels, tables: Tables) -> SensorFrames:
        there = part.frames["number_of_points"].is_valid().to_pylist()
        numbers = part.frames["frame"].to_pylist()
        names = [
            f"{part.sequence}/{number:06d}{_POINTS}" if has else None
            for number, has in zip(numbers, there, strict=True)
        ]
        poses = lidar_poses(part)

        def place(row: int) -> tuple[FloatArray, FloatArray]:
            return EGO_T_LEVEL @ inverse(poses[row]), np.empty(0)

        tokens = self._calibrated(LIDAR, poses, there, place, tables)
        if self._folder is not None and any(there):
            self._write_points(part, names, self._folder / "samples" / LIDAR)
        return SensorFrames(LIDAR, names, tokens, [(0, 0)] * len(there))

    def _write_points(self, part: SequenceLabels, names: list[str | None], folder: Path) -> None:
        """Write x, y, z, intensity and ring, five float32 a point; the ring is unknown: 0."""
        points = FramePoints(part)
        (folder / part.sequence).mkdir(parents=True, exist_ok=True)
        for row, name in enumerate(names):
            if name is not None:
                found = points.read(row)
                whole = np.zeros((len(found), 5), dtype="<f4")
                whole[:, :3], whole[:, 3] = found[:, :3], found[:, 3] * _FULL_INTENSITY
                (folder / name).write_bytes(whole.tobytes())
                self.files += 1

    def _calibrated(
        self,
        channel: str,
        numbers: FloatArray,
        there: list[bool],
        place: Callable[[int], tuple[FloatArray, FloatArray]],
        tables: Tables,
    ) -> list[str]:
        """Return the token of each frame's calibration; writes those that are new."""
        tokens = []
        for row, has in enumerate(there):
            key = token("calibrated_sensor", channel, numbers[row].tobytes().hex()) if has else ""
            tokens.append(key)
            if has and key not in self._known:
                self._known.add(key)
                ego_T_sensor, intrinsic = place(row)
                tables["calibrated_sensor"].extend(
                    [
                        {
                            "token": key,
                            "sensor_token": token("sensor", channel),
                            "translation": ego_T_sensor[:3, 3].tolist(),
                            "rotation": quaternions(ego_T_sensor[None, :3, :3])[0].tolist(),
                            "camera_intrinsic": intrinsic.tolist(),
                        }
                    ]
                )
        return tokens
