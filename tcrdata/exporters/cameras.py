"""Boxes as cameras have them: carried into the camera frame, and as boxes in the image."""

from __future__ import annotations

import numpy as np

from tcrdata.exporters.labels import ChosenLabels, SequenceLabels
from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.store.table_arrays import columns, matrices, truths
from tcrdata.types import BoolArray, FloatArray

_NEAREST_M = 0.01
_BOX_2D = ("left_px", "top_px", "right_px", "bottom_px")


def camera_poses(part: SequenceLabels) -> FloatArray:
    """Return (F, 4, 4) `camera_T_level` of every frame; the identity where there is no camera."""
    poses = matrices(part.frames, "camera_T_level", (4, 4))
    poses[np.isnan(poses).any(axis=(1, 2))] = np.eye(4)
    return poses


def camera_boxes(boxes: FloatArray, camera_T_level: FloatArray) -> FloatArray:
    """Turn boxes of the level frame into KITTI's numbers.

    The geometric centre and the heading are carried into the camera frame; half the height is
    added along the camera's y. Readers that undo this get the exact centre even where the camera
    is tilted against the level frame.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw.
        camera_T_level: (N, 4, 4).

    Returns:
        (N, 7) height, width, length, x, y, z of the bottom centre, rotation_y in (-pi, pi].
    """
    rotation, shift = camera_T_level[:, :3, :3], camera_T_level[:, :3, 3]
    center = np.einsum("nij,nj->ni", rotation, boxes[:, :3]) + shift
    yaw = boxes[:, 6]
    heading = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    heading = np.einsum("nij,nj->ni", rotation, heading)
    center[:, 1] += boxes[:, 5] / 2
    rotation_y = np.arctan2(-heading[:, 2], heading[:, 0])
    return np.column_stack([boxes[:, 5], boxes[:, 4], boxes[:, 3], center, rotation_y])


def standing_boxes(boxes: FloatArray, camera_T_level: FloatArray) -> FloatArray:
    """Turn boxes of the level frame into those that MMDetection3D turns on into a LiDAR's.

    The place where a box stands is carried into the camera frame; the heading stays the one about
    the vertical. KittiDataset carries that place into the LiDAR's frame and adds half the height
    there: centre and heading are exact where the LiDAR is level, however the camera is tilted.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw.
        camera_T_level: (N, 4, 4).

    Returns:
        (N, 7) x, y, z of the bottom centre, length, height, width, yaw in (-pi, pi].
    """
    foot = boxes[:, :3] + np.array([0.0, 0.5, 0.0]) * boxes[:, 5:6]
    foot = np.einsum("nij,nj->ni", camera_T_level[:, :3, :3], foot) + camera_T_level[:, :3, 3]
    return np.column_stack([foot, boxes[:, [3, 5, 4]], wrapped(boxes[:, 6])])


def observation_angle(camera: FloatArray) -> FloatArray:
    """Return (N,) alpha = rotation_y - atan2(x, z), in (-pi, pi], of `camera_boxes` rows."""
    return wrapped(camera[:, 6] - np.arctan2(camera[:, 3], camera[:, 5]))


def wrapped(angle: FloatArray) -> FloatArray:
    """Return the same angles in (-pi, pi]."""
    return np.asarray(np.pi - (np.pi - angle) % (2 * np.pi))


def image_boxes(part: SequenceLabels) -> FloatArray:
    """Return (N, 4) left, top, right, bottom in pixels, clipped; NaN for what no image shows.

    The labels' own; where they have none, the box around the eight projected corners.
    """
    image = columns(part.labels, _BOX_2D)
    missing = np.flatnonzero(np.isnan(image).any(axis=1))
    if len(missing):
        rows = part.frame_rows[missing]
        projection = matrices(part.frames, "projection", (3, 4)) @ camera_poses(part)
        size = columns(part.frames, ("width_px", "height_px"))
        image[missing] = projected_boxes(part.boxes[missing], projection[rows], size[rows])
    return image


def has_camera(part: SequenceLabels) -> BoolArray:
    """Return (N,) which labels are in a frame with a camera."""
    return truths(part.frames["projection"].is_valid())[part.frame_rows]


def shown(part: SequenceLabels) -> BoolArray:
    """Return (N,) which labels have a box in an image."""
    return np.asarray(~np.isnan(image_boxes(part)[:, 0]))


def unseen_line(chosen: ChosenLabels, labels: int, ignored: int) -> str:
    """Return what a card says of the labels that no image shows, given how many were written."""
    return (
        f"{chosen.total - labels} labels and {chosen.ignored - ignored} ignore regions "
        "that no image shows"
    )


def pictured(part: SequenceLabels) -> BoolArray:
    """Return (N,) which labels have a box in an image that is there."""
    return shown(part) & truths(part.frames["has_image"])[part.frame_rows]


def box_corners(boxes: FloatArray) -> FloatArray:
    """Return the (N, 8, 3) corners of (N, 7) boxes, the four upper ones first; level frame."""
    flat = box_corners_bev(boxes)
    half = boxes[:, 5:6] / 2
    sides = [
        np.stack([flat[:, :, 0], np.broadcast_to(y, flat.shape[:2]), flat[:, :, 1]], axis=2)
        for y in (boxes[:, 1:2] - half, boxes[:, 1:2] + half)
    ]
    return np.concatenate(sides, axis=1)


def projected_boxes(boxes: FloatArray, projection: FloatArray, size: FloatArray) -> FloatArray:
    """Return (N, 4) boxes in pixels around the projected corners of (N, 7) boxes, clipped.

    Args:
        boxes: level frame.
        projection: (N, 3, 4) level frame to homogeneous pixels.
        size: (N, 2) width and height of the image.

    Returns:
        NaN for boxes that reach behind the camera or stand outside the image.
    """
    corners = box_corners(boxes)
    shift = projection[:, None, :, 3]
    pixels = np.einsum("nij,nkj->nki", projection[:, :, :3], corners) + shift
    depth = pixels[:, :, 2]
    in_front = (depth > _NEAREST_M).all(axis=1)
    pixels = pixels[:, :, :2] / np.where(depth > _NEAREST_M, depth, np.nan)[:, :, None]
    low = np.clip(pixels.min(axis=1), 0, size - 1)
    high = np.clip(pixels.max(axis=1), 0, size - 1)
    seen = in_front & (high > low).all(axis=1)
    return np.where(seen[:, None], np.concatenate([low, high], axis=1), np.nan)
