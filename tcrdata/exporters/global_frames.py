"""Boxes, poses and cameras with z up: the global frame that a chain of egomotions gives.

global: the level frame of a scene's first frame, its axes renamed: x forward, y left, z up.
ego: the level frame of each frame with the same renaming; its origin is the camera's place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from tcrdata.geometry.transforms import inverse
from tcrdata.types import FloatArray

EGO_T_LEVEL: FloatArray = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""(4, 4): x forward, y left, z up, from x right, y down, z forward."""


def chained_poses(steps: Sequence[Sequence[float] | None]) -> FloatArray:
    """Return (F, 4, 4) `global_T_ego` of frames in order.

    With `to_T_from` of a step, `world_T_level[to] = world_T_level[from] @ inverse(to_T_from)`;
    `global_T_ego = A @ world_T_level @ inverse(A)` with `A = EGO_T_LEVEL`.

    Args:
        steps: 16 numbers, the motion from the frame before; None where a scene begins.
    """
    level_T_ego = EGO_T_LEVEL.T
    pose = np.eye(4)
    poses = np.empty((len(steps), 4, 4))
    for row, step in enumerate(steps):
        pose = np.eye(4) if step is None else pose @ inverse(np.reshape(step, (4, 4)))
        poses[row] = EGO_T_LEVEL @ pose @ level_T_ego
    return poses


def global_boxes(boxes: FloatArray, global_T_ego: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Carry boxes of the level frame into the global frame.

    Args:
        boxes: (N, 7) x, y, z, length, width, height, yaw.
        global_T_ego: (N, 4, 4), of each box's frame.

    Returns:
        (N, 3) geometric centres and (N, 3, 3) rotations, whose columns are the box's axes:
        length (forward), width (left), height (up).
    """
    global_T_level = global_T_ego @ EGO_T_LEVEL
    rotation, shift = global_T_level[:, :3, :3], global_T_level[:, :3, 3]
    center = np.einsum("nij,nj->ni", rotation, boxes[:, :3]) + shift
    c, s = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    zero, one = np.zeros_like(c), np.ones_like(c)
    axes = np.stack(
        [np.stack([c, zero, -s], 1), np.stack([s, zero, c], 1), np.stack([zero, -one, zero], 1)], 2
    )
    return center, np.einsum("nij,njk->nik", rotation, axes)


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return (N, 4) unit quaternions of (N, 3, 3) rotations: w first, w >= 0."""
    found = Rotation.from_matrix(rotations).as_quat(canonical=True, scalar_first=True)
    return np.asarray(found, dtype=np.float64)


def split_projection(projection: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split a projection into intrinsics and place: `projection ~ K @ pinhole_T_camera[:3]`.

    KITTI's cameras stand beside the one that its camera frame belongs to: the fourth column of
    their projection holds by how much.

    Args:
        projection: (3, 4) camera frame to homogeneous pixels.

    Returns:
        (3, 3) upper triangular intrinsics with `K[2, 2] = 1`, and (4, 4) pinhole_T_camera.
    """
    intrinsic, rotation = rq(projection[:, :3])
    signs = np.diag(np.where(np.diag(intrinsic) < 0, -1.0, 1.0))
    intrinsic, rotation = intrinsic @ signs, signs @ rotation
    pinhole_T_camera = np.eye(4)
    pinhole_T_camera[:3, :3] = rotation
    pinhole_T_camera[:3, 3] = np.linalg.solve(intrinsic, projection[:, 3])
    return intrinsic / intrinsic[2, 2], pinhole_T_camera
