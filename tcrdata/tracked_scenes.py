"""A sequence's frames as trackers see them: points without ground, features, boxes, visibility."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcrdata.errors import EvidenceError, FrameError, MissingEvidenceError
from tcrdata.evidence.ground import Settings as PlaneSettings
from tcrdata.evidence.ground import ground_plane
from tcrdata.evidence.models import Model
from tcrdata.evidence.point_rows import decode_matching, read_encoded
from tcrdata.evidence.poses import Poses, read_poses
from tcrdata.evidence.range_images import (
    LidarCells,
    RangeGrid,
    RangeImage,
    cells_of,
    range_image,
    sensor_grid,
)
from tcrdata.evidence.world import World, make_world
from tcrdata.executors import one_ahead
from tcrdata.geometry.transforms import inverse
from tcrdata.ingest import frames_of
from tcrdata.plan import ROUND
from tcrdata.store import Store, Unit
from tcrdata.tracking.cell_points import cell_points
from tcrdata.tracking.near_points import first_returns, world_points
from tcrdata.tracking.point_features import colour_features, reflectance_features, unit
from tcrdata.tracking.scenes import Candidates, Scene
from tcrdata.types import (
    BOX_COLUMNS,
    BoolArray,
    Dataset,
    Float32Array,
    FloatArray,
    Frame,
    PointCloud,
    Sensor,
    Tables,
)

_CELLS = LidarCells()
_UNDECIDED = 0.5
_ABOVE_M = 0.2  # times the metric scale: depth noise keeps a table about this thick


class FrameView:
    """Rays of one frame's sensor, in the world; satisfies `tcrdata.tracking.scenes.View`."""

    def __init__(
        self, frame: Frame, sensor: Sensor, points: PointCloud, world_T_level: FloatArray
    ) -> None:
        self._grid: RangeGrid = sensor_grid(frame, sensor, _CELLS)
        self._image: RangeImage = range_image(points.xyz, self._grid)
        sensor_T_level = np.vstack([self._grid.sensor_T_level, [0, 0, 0, 1]]).astype(np.float64)
        self._sensor_T_world = (sensor_T_level @ inverse(world_T_level))[:3].astype(np.float32)
        self.origin: FloatArray = np.asarray(
            world_T_level[:3, :3] @ inverse(sensor_T_level)[:3, 3] + world_T_level[:3, 3]
        )

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ranges of (N, 3) world points and of the first returns on their rays."""
        columns = np.ascontiguousarray(points.T, dtype=np.float32)
        cells, ranges = cells_of(columns, self._sensor_T_world, self._grid)
        first = first_returns(cells, self._image.nearest_m, self._image.window_m)
        return ranges.astype(np.float64), first


@dataclass(frozen=True)
class SceneSource:
    """All that is needed to read one sequence's scenes.

    Attributes:
        dataset: reads points and images.
        sensor: lidar or depth.
        metric_scale: of the sequence.
        tables: of the sequence, first round.
        labels: frame to the rows of the labels there.
        world: its frames with their poses.
        heat: proposal to s * o, where a network has spoken.
        plane: (a, b, c) of the table's plane y = a x + b z + c, for sequences whose ground was not
            measured; None where it was, or for a LiDAR.
        model: detector whose features are correlated; None for colour or reflectance.
        beside: whether each frame is read in a thread while the one before is used.
    """

    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    tables: Tables
    world: World
    labels: Mapping[int, list[dict[str, Any]]]
    heat: Mapping[str, float]
    plane: FloatArray | None = None
    model: Model | None = None
    beside: bool = False

    def scenes(self, failed: Callable[[int, str], None]) -> Iterator[Scene]:
        """Yield every frame that can be read; the others are told to `failed`, with the reason.

        Raises:
            EvidenceError: no frame can be read.
        """
        scenes = self._scenes(failed)
        return one_ahead(scenes) if self.beside else scenes

    def _scenes(self, failed: Callable[[int, str], None]) -> Iterator[Scene]:
        read, reason = 0, ""
        for number, frame in self.world.frames.items():
            try:
                cloud = self.dataset.read_points(frame)
            except FrameError as error:
                reason = str(error)
                failed(number, reason)
                continue
            read += 1
            yield self.scene(number, frame, cloud)
        if not read:
            raise EvidenceError(f"none of {len(self.world.frames)} frames can be read: {reason}")

    def scene(self, number: int, frame: Frame, cloud: PointCloud) -> Scene:
        """Return one frame."""
        pose = self.world.poses.world_T_level[number]
        kept = ~self._ground(number, cloud)
        points = world_points(cloud.xyz, kept, pose.astype(np.float32))
        return Scene(
            number,
            cell_points(points),
            self._features(frame, cloud, kept),
            self._candidates(number, self.labels.get(number, [])),
            FrameView(frame, self.sensor, cloud, pose),
        )

    def _ground(self, number: int, cloud: PointCloud) -> BoolArray:
        """Return (N,) which points are the ground's: as measured, else those near the table."""
        ground = read_encoded(self.tables, number, "ground", round=ROUND)
        if ground is not None:
            return np.asarray(decode_matching(ground, len(cloud)), dtype=bool)
        if self.plane is None:
            return np.zeros(len(cloud), dtype=bool)
        a, b, c = self.plane
        above = a * cloud.xyz[:, 0] + b * cloud.xyz[:, 2] + c - cloud.xyz[:, 1]
        return np.asarray(above <= _ABOVE_M * self.metric_scale)

    def _features(self, frame: Frame, cloud: PointCloud, kept: np.ndarray) -> Float32Array:
        """What the detector makes of the points; without one, colour or a LiDAR's reflectance."""
        if self.model is not None:
            # Most trackings are without one.
            from tcrdata.evidence.detector_features import detector_features
            from tcrdata.evidence.objectness3d import EVIDENCE

            rows = ((e, read_encoded(self.tables, frame.frame, e, round=ROUND)) for e in EVIDENCE)
            known = {name: row for name, row in rows if row is not None}
            found = detector_features(self.model, frame, cloud, known, self.metric_scale)
            if found is not None:
                ones = np.ones((len(cloud), 1), np.float32)
                both: Float32Array = unit(np.column_stack([ones, unit(found)]))
                return np.asarray(both[kept])
        if self.sensor == "depth" and frame.has_image and cloud.pixels is not None:
            try:
                image = self.dataset.read_image(frame)
            except FrameError:
                image = None
            if image is not None:
                return colour_features(image, cloud.pixels[kept])
        return reflectance_features(cloud.reflectance[kept])

    def _candidates(self, number: int, rows: list[dict[str, Any]]) -> Candidates:
        boxes = np.array([[row[name] for name in BOX_COLUMNS] for row in rows]).reshape(-1, 7)
        placed = np.array([self.world.box_to_world(number, box) for box in boxes]).reshape(-1, 7)
        return Candidates(
            placed,
            np.array([self._heat(row) for row in rows]),
            np.array([row["state"] == "positive" for row in rows], dtype=bool),
            tuple(row["track_id"] for row in rows),
        )

    def _heat(self, row: dict[str, Any]) -> float:
        """A label is an object; what is undecided is one as far as the networks say so."""
        return 1.0 if row["state"] == "positive" else self.heat.get(row["proposal_id"], _UNDECIDED)


def scene_source(
    store: Store,
    dataset: Dataset,
    name: str,
    sequence: str,
    labels: list[dict[str, Any]],
    round: int,
    model: Model | None = None,
    *,
    beside: bool = False,
) -> SceneSource:
    """Return what one sequence's scenes are read from.

    Args:
        store: holds the sequence.
        dataset: reads its files.
        name: of the dataset.
        sequence: the drive or clip.
        labels: rows of a selection's labels there.
        round: EM round of the selection: what later ones say of its labels is not heard.
        model: detector whose features are correlated; None for colour or reflectance.
        beside: whether frames are read in a thread.

    Raises:
        MissingEvidenceError: the sequence was not built, or has no egomotion.
    """
    tables = store.tables(name, sequence, ROUND)
    (info,) = tables.read("sequences").to_pylist() or [None]
    if info is None:
        raise MissingEvidenceError(f"{name}/{sequence} is not in the store: build it first")
    frames = list(frames_of(store, name, sequence))
    world = make_world(frames, _poses(tables, frames, still=info["static_camera"]))
    if not world.frames:
        raise MissingEvidenceError(
            f"{name}/{sequence}: tracking needs egomotion, which no build has measured: build with "
            "--preset tcrdata"
        )
    by_frame: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for row in labels:
        by_frame[row["frame"]].append(row)
    return SceneSource(
        dataset, info["sensor"], info["metric_scale"], tables, world, by_frame,
        _heat(store, name, sequence, labels, round), _plane(store, dataset, world, info), model,
        beside,
    )  # fmt: skip


def _poses(tables: Tables, frames: list[Frame], *, still: bool) -> Poses:
    """Return the measured poses; of a camera that is known to stand still all the same one."""
    for method in ("odometry", "flow_ransac"):
        poses = read_poses(tables, method)
        if poses.segment:
            return poses
    numbers = [frame.frame for frame in frames] if still else []
    return Poses({n: np.eye(4) for n in numbers}, dict.fromkeys(numbers, 0))


def _plane(store: Store, dataset: Dataset, world: World, info: dict[str, Any]) -> FloatArray | None:
    """Return the table's plane, of the first frame that can be read; None where ground is known."""
    name, sequence, scale = info["dataset"], info["sequence"], info["metric_scale"]
    measured = store.record(Unit("ground", name, sequence, ROUND)) is not None
    if measured or info["sensor"] != "depth":
        return None
    own = PlaneSettings()
    own = replace(own, plane_margin_m=own.plane_margin_m * scale)
    for frame in world.frames.values():
        try:
            xyz = dataset.read_points(frame).xyz
        except FrameError:
            continue
        if len(xyz) >= own.minimum_points:
            return ground_plane(xyz, own)
    return None


def _heat(
    store: Store, name: str, sequence: str, labels: list[dict[str, Any]], round: int
) -> dict[str, float]:
    """Return s * o of each label that a network has judged, in the newest round up to one."""
    wanted = {row["proposal_id"] for row in labels}
    heat: dict[str, dict[str, tuple[int, float]]] = defaultdict(dict)
    for module in ("objectness_2d", "objectness_3d"):
        rows = store.read(
            "confidences", columns=["proposal_id", "round", "confidence"], dataset=name,
            sequence=sequence, module=module,
        ).to_pylist()  # fmt: skip
        for row in rows:
            heard = row["round"] <= round and row["confidence"] is not None
            if heard and row["proposal_id"] in wanted:
                known = heat[row["proposal_id"]].get(module, (0, 0.0))
                heat[row["proposal_id"]][module] = max(known, (row["round"], row["confidence"]))
    return {key: float(np.prod([v for _, v in own.values()])) for key, own in heat.items()}
