"""A Rerun recording: one frame after the other, points, boxes, trails and the image in one world.

Entities, below `world` (x right, y down, z ahead of the segment's first frame):
    world/ego                       path of the sensor over the segment
    world/trails                    where labelled tracks were in the last frames
    world/level                     transform of the frame's level frame into the world
    world/level/points              coloured by free-space votes
    world/level/boxes/<kind>        labels, ignored, rejected, truth
    world/level/camera              pinhole; world/level/camera/image is its picture
    plots/count/<kind>, plots/score/<track>, plots/points/<track>    one number a frame
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from tcrdata.geometry.transforms import inverse
from tcrdata.types import FloatArray, ImageArray, IntArray
from tcrdata.views.palette import (
    EGO,
    NO_VOTE,
    SEEN_AGAIN,
    SEEN_THROUGH,
    STYLES,
    TRACKS,
    box_style,
    rgb,
)
from tcrdata.views.rerun_blueprint import FRAME_TIMELINE, viewer_blueprint

TIME_TIMELINE = "timestamp"
TRAIL_FRAMES = 30
_JPEG_QUALITY = 85
_POINT_RADIUS_PX = 1.2
_LINE_RADIUS_PX = 1.5
_IMAGE_PLANE_M = 4.0
_CLASSES = (
    (0, "no vote", NO_VOTE),
    (1, "seen again", SEEN_AGAIN),
    (2, "seen through", SEEN_THROUGH),
)


@dataclass(frozen=True)
class RecordedBoxes:
    """Boxes of one kind in one frame.

    Attributes:
        boxes: (N, 7), level frame.
        names: N tracks or objects; empty where there is none.
        scores: (N,) in [0, 1]; NaN where there is none.
        points: (N,) points in each box; NaN where nobody counted.
    """

    boxes: NDArray[np.floating]
    names: Sequence[str]
    scores: NDArray[np.floating]
    points: NDArray[np.floating]


@dataclass(frozen=True)
class RecordedFrame:
    """All that the recording shows of one frame.

    Attributes:
        frame: number.
        timestamp_ns: UTC; None without a clock.
        world_T_level: (4, 4).
        segment: frames of one number share a world.
        path: (F, 3) positions of the sensor over the segment, in its world.
        points: (N, 3), level frame.
        classes: (N,) as `birds_eye.vote_classes` gives them.
        boxes: kind to boxes; kinds left out are shown empty.
        image: (H, W, 3) RGB, or None.
        projection: (3, 4) camera frame to homogeneous pixels, or None without a camera.
        camera_T_level: (4, 4).
    """

    frame: int
    timestamp_ns: int | None
    world_T_level: FloatArray
    segment: int
    path: FloatArray
    points: NDArray[np.floating]
    classes: IntArray
    boxes: Mapping[str, RecordedBoxes]
    image: ImageArray | None = None
    projection: FloatArray | None = None
    camera_T_level: FloatArray = field(default_factory=lambda: np.eye(4))


class RerunRecording:
    """A `.rrd` file that frames are added to; it is complete once the `with` block ends."""

    def __init__(self, path: Path, name: str, metric_scale: float = 1.0) -> None:
        """Start the file.

        Args:
            path: of the file, replaced when it is there.
            name: of the recording, as the viewer lists it.
            metric_scale: metres here a metre of a road scene.
        """
        self._scale = metric_scale
        self._segment: int | None = None
        self._trails: dict[str, deque[FloatArray]] = {}
        self._plotted: set[str] = set()
        # No properties and no clock: the same store gives the same content.
        self._stream = rr.RecordingStream("tcrdata", recording_id=name, send_properties=False)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.save(path, default_blueprint=viewer_blueprint(metric_scale))
        self._stream.send_recording_name(name)
        self._log_constants()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stream.flush()
        self._stream.disconnect()

    def add(self, shot: RecordedFrame) -> None:
        """Write one frame at its number and its timestamp."""
        self._stream.reset_time()
        self._stream.set_time(FRAME_TIMELINE, sequence=shot.frame)
        if shot.timestamp_ns is not None:
            moment = np.datetime64(shot.timestamp_ns, "ns")
            self._stream.set_time(TIME_TIMELINE, timestamp=moment)
        if shot.segment != self._segment:
            self._segment, self._trails = shot.segment, {}
            self._log_path(shot.path)
        self._stream.log("world/level", _transform(shot.world_T_level))
        self._log_points(shot)
        for kind in STYLES:
            self._log_boxes(kind, shot.boxes.get(kind))
        self._log_trails(shot)
        self._log_camera(shot)
        self._log_plots(shot)

    def _log_constants(self) -> None:
        context = rr.AnnotationContext([(n, name, rgb(color)) for n, name, color in _CLASSES])
        self._stream.log("world", rr.ViewCoordinates.RDF, static=True)
        self._stream.log("world/level/points", context, static=True)
        for kind, style in STYLES.items():
            line = rr.SeriesLines(colors=[rgb(style.color)], names=[kind])
            self._stream.log(f"plots/count/{kind}", line, static=True)

    def _log_path(self, path: FloatArray) -> None:
        strip = rr.LineStrips3D([path], colors=[rgb(EGO)], radii=-_LINE_RADIUS_PX)
        self._stream.log("world/ego", strip)

    def _log_points(self, shot: RecordedFrame) -> None:
        points = rr.Points3D(
            np.asarray(shot.points, dtype=np.float32),
            class_ids=shot.classes.astype(np.uint16),
            radii=-_POINT_RADIUS_PX,
        )
        self._stream.log("world/level/points", points)

    def _log_boxes(self, kind: str, found: RecordedBoxes | None) -> None:
        """Empty kinds are written too, or the viewer would go on showing the frame before."""
        boxes = np.empty((0, 7)) if found is None else np.asarray(found.boxes).reshape(-1, 7)
        half_yaw = boxes[:, 6] / 2
        nothing = np.zeros(len(boxes))
        style = box_style(kind)
        names = [] if found is None else _captions(found)
        drawn = rr.Boxes3D(
            centers=boxes[:, :3],
            sizes=boxes[:, [3, 5, 4]],
            quaternions=np.stack([nothing, np.sin(half_yaw), nothing, np.cos(half_yaw)], axis=1),
            colors=[rgb(style.color)],
            radii=-style.width_pt,
            fill_mode="transparentfillmajorwireframe" if style.fill_alpha else "majorwireframe",
            labels=names,
            show_labels=False,
        )
        self._stream.log(f"world/level/boxes/{kind}", drawn)

    def _log_trails(self, shot: RecordedFrame) -> None:
        """Each label's centre in the world, over the last frames."""
        labels = shot.boxes.get("labels")
        seen = {} if labels is None else dict(zip(labels.names, labels.boxes, strict=True))
        rotation, shift = shot.world_T_level[:3, :3], shot.world_T_level[:3, 3]
        for name, box in seen.items():
            if name:
                trail = self._trails.setdefault(name, deque(maxlen=TRAIL_FRAMES))
                trail.append(rotation @ np.asarray(box[:3], dtype=np.float64) + shift)
        for name in set(self._trails) - set(seen):
            self._trails[name].popleft()
        self._trails = {name: trail for name, trail in self._trails.items() if trail}
        strips = rr.LineStrips3D(
            [np.array(trail) for trail in self._trails.values()],
            colors=[_track_color(name) for name in self._trails],
            radii=-_LINE_RADIUS_PX,
        )
        self._stream.log("world/trails", strips)

    def _log_camera(self, shot: RecordedFrame) -> None:
        if shot.projection is None:
            return
        matrix = shot.projection[:, :3] / shot.projection[2, 2]
        # A camera beside the frame's origin (KITTI's colour camera) has a fourth column.
        camera_T_level = shot.camera_T_level.copy()
        camera_T_level[:3, 3] += np.linalg.solve(shot.projection[:, :3], shot.projection[:, 3])
        self._stream.log("world/level/camera", _transform(inverse(camera_T_level)))
        resolution = None if shot.image is None else shot.image.shape[1::-1]
        pinhole = rr.Pinhole(
            image_from_camera=matrix,
            resolution=resolution,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=_IMAGE_PLANE_M * self._scale,
        )
        self._stream.log("world/level/camera", pinhole)
        if shot.image is not None:
            picture = rr.Image(shot.image).compress(jpeg_quality=_JPEG_QUALITY)
            self._stream.log("world/level/camera/image", picture)
        else:
            self._stream.log("world/level/camera/image", rr.Clear(recursive=False))

    def _log_plots(self, shot: RecordedFrame) -> None:
        for kind in STYLES:
            found = shot.boxes.get(kind)
            count = 0 if found is None else len(found.boxes)
            self._stream.log(f"plots/count/{kind}", rr.Scalars(count))
        labels = shot.boxes.get("labels")
        if labels is None:
            return
        for name, score, points in zip(labels.names, labels.scores, labels.points, strict=True):
            if name:
                self._plot_track("score", name, score)
                self._plot_track("points", name, points)

    def _plot_track(self, what: str, name: str, value: float) -> None:
        entity = f"plots/{what}/{name}"
        if entity not in self._plotted:
            self._plotted.add(entity)
            line = rr.SeriesLines(colors=[_track_color(name)], names=[name])
            self._stream.log(entity, line, static=True)
        self._stream.log(entity, rr.Scalars(value))


def _transform(parent_T_child: FloatArray) -> rr.Transform3D:
    return rr.Transform3D(translation=parent_T_child[:3, 3], mat3x3=parent_T_child[:3, :3])


def _captions(found: RecordedBoxes) -> list[str]:
    return [
        name if np.isnan(score) else f"{name} {score:.2f}".strip()
        for name, score in zip(found.names, found.scores, strict=True)
    ]


def _track_color(name: str) -> tuple[int, int, int]:
    """The same colour for a track in every frame, whichever others there are."""
    return rgb(TRACKS[sum(name.encode()) % len(TRACKS)])
