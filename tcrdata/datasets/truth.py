"""The exact truth about a scripted scene: boxes, silhouettes, hidden shares and optical flow."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcrdata.datasets.scene import Scene, SceneObject, View
from tcrdata.geometry.boxes import min_area_box
from tcrdata.geometry.raycasting import cast, count_pixels
from tcrdata.geometry.transforms import inverse, transform_points
from tcrdata.types import Float32Array, FloatArray

NEAR_M = 0.05
# Cosine between an object's own vertical and gravity, below which it counts as tilted.
UPRIGHT_COSINE = 0.9999
# Columns length, height (down), width, in an object's axes length, width, height (up).
OBJECT_R_TRUTH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def truth_rows(scene: Scene, view: View, time_s: float, frame: int) -> list[dict[str, Any]]:
    """Return one row of `ground_truth` for every object, seen or not.

    Args:
        scene: the scene.
        view: the camera at that time.
        time_s: when.
        frame: its number.

    Returns:
        Rows without dataset, sequence and round. The box is upright in the level frame: around a
        tilted object it is the smallest one. `occluded` is the share of the silhouette inside the
        image that other things hide (1 when none of it is in the image), `truncated` the share of
        the 2D box that lies outside. Where no point is before the camera the 2D box is None.
    """
    boxes = [_image_box(scene_object, view, time_s) for scene_object in scene.objects]
    windows = np.array([_window(box, view) for box in boxes]).reshape(-1, 4)
    visible, whole = count_pixels(scene.primitives(time_s), view.origin, view.pixel_rays, windows)
    rows = []
    for number, (box, seen, all_of_it) in enumerate(zip(boxes, visible, whole, strict=True)):
        thing, container = scene.objects[number], scene.container(number, time_s)
        row = _box_row(thing, view, time_s)
        row.update(_image_row(box, view))
        row["frame"] = frame
        row["visible_px"] = int(seen)
        row["occluded"] = 1.0 - float(seen) / float(all_of_it) if all_of_it else 1.0
        row["speed_mps"] = thing.speed(time_s)
        row["contained_in"] = container.object_id if container else None
        rows.append(row)
    return rows


def exact_flow(
    scene: Scene, view: View, time_s: float, view_to: View, time_to_s: float
) -> Float32Array:
    """Return the (H, W, 2) motion in pixels of what each pixel centre sees.

    Surfaces are followed whether or not they stay visible; NaN where nothing is seen, or where the
    surface goes behind the camera.
    """
    primitives = scene.primitives(time_s)
    rays = view.rays()
    times, hits = cast(primitives, view.origin, rays)
    points = view.origin + np.where(np.isfinite(times), times, np.nan)[:, None] * rays
    owners = np.where(hits >= 0, primitives.owners[hits], -1)
    for number in np.unique(owners[owners >= 0]):
        motion = scene.objects[number].motion
        moved = motion.pose(time_to_s) @ inverse(motion.pose(time_s))
        points[owners == number] = transform_points(moved, points[owners == number])
    pixels, _ = view_to.project(points)
    rows, columns = np.mgrid[0 : view.camera.height_px, 0 : view.camera.width_px]
    start = np.stack([columns, rows], axis=-1)
    flow: Float32Array = (pixels.reshape(start.shape) - start).astype(np.float32)
    return flow


def _box_row(thing: SceneObject, view: View, time_s: float) -> dict[str, Any]:
    level_T_object = view.level_T_world @ thing.motion.pose(time_s)
    rotation = level_T_object[:3, :3]
    centre, size = level_T_object[:3, 3], np.asarray(thing.size_m)
    yaw = math.atan2(-rotation[2, 0], rotation[0, 0])
    tilted = bool(-rotation[1, 2] < UPRIGHT_COSINE)
    if tilted:
        outline = transform_points(level_T_object, thing.outline())
        box = min_area_box(outline[:, [0, 2]])
        low, high = outline[:, 1].max(), outline[:, 1].min()
        centre = np.array([box.cx, 0.5 * (low + high), box.cz])
        size, yaw = np.array([box.length, box.width, low - high]), box.yaw_rad
    return {
        "object_id": thing.object_id,
        "category": thing.category,
        **dict(zip(("x_m", "y_m", "z_m"), map(float, centre), strict=True)),
        **dict(zip(("length_m", "width_m", "height_m"), map(float, size), strict=True)),
        "yaw_rad": math.remainder(yaw, 2 * math.pi),
        "level_R_object": [float(v) for v in (rotation @ OBJECT_R_TRUTH).ravel()],
        "object_size_m": [thing.size_m[0], thing.size_m[2], thing.size_m[1]],
        # What is round seen from above is not when it lies on its side; a ball always is.
        "yaw_observable": thing.yaw_observable or (tilted and thing.category != "sphere"),
    }


def _image_box(thing: SceneObject, view: View, time_s: float) -> FloatArray | None:
    """Left, top, right, bottom of the whole silhouette, not clipped; None when out of view."""
    world = transform_points(thing.motion.pose(time_s), thing.outline())
    pixels, depth = view.project(world)
    pixels = pixels[depth > NEAR_M]
    if not len(pixels):
        return None
    box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    size = (view.camera.width_px - 1, view.camera.height_px - 1)
    if box[0] > size[0] or box[1] > size[1] or box[2] < 0 or box[3] < 0:
        return None
    return box


def _window(box: FloatArray | None, view: View) -> tuple[int, int, int, int]:
    if box is None:
        return 0, 0, 0, 0
    width, height = view.camera.width_px, view.camera.height_px
    return (
        max(0, math.floor(box[0]) - 1),
        max(0, math.floor(box[1]) - 1),
        min(width, math.ceil(box[2]) + 2),
        min(height, math.ceil(box[3]) + 2),
    )


def _image_row(box: FloatArray | None, view: View) -> dict[str, Any]:
    names = ("left_px", "top_px", "right_px", "bottom_px")
    if box is None:
        return {**dict.fromkeys(names), "truncated": 1.0}
    limits = np.array([view.camera.width_px - 1, view.camera.height_px - 1] * 2, dtype=np.float64)
    clipped = np.clip(box, 0.0, limits)
    inside = np.prod(clipped[2:] - clipped[:2]) / np.prod(box[2:] - box[:2])
    return {
        **dict(zip(names, map(float, clipped), strict=True)),
        "truncated": float(np.clip(1.0 - inside, 0.0, 1.0)),
    }
