"""Points of depth images: every pixel that has a depth, along its ray."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcrdata.geometry.kernels import compiled
from tcrdata.types import Float32Array, FloatArray


def unprojected(
    depth: FloatArray, intrinsics: FloatArray, level_T_camera: FloatArray
) -> tuple[Float32Array, NDArray[np.int32]]:
    """Return (N, 3) points in the level frame and the (N, 2) columns and rows that they are of.

    Args:
        depth: (H, W) metres along the view; 0 where there is none.
        intrinsics: (3, 3), pixels.
        level_T_camera: (4, 4), camera to level frame.
    """
    inverse = np.asarray(np.linalg.inv(intrinsics), np.float64)
    return _unprojected(np.asarray(depth, np.float64), inverse, level_T_camera)


# One pass over all, one term after the other: a matrix product could round as its threads share
# it out.
@compiled
def _unprojected(
    depth: FloatArray, inverse: FloatArray, level_T_camera: FloatArray
) -> tuple[Float32Array, NDArray[np.int32]]:
    rows, columns = depth.shape
    count = 0
    for v in range(rows):
        for u in range(columns):
            count += depth[v, u] > 0
    xyz, pixels = np.empty((count, 3), np.float32), np.empty((count, 2), np.int32)
    place = np.empty(3)
    n = 0
    for v in range(rows):
        for u in range(columns):
            if not depth[v, u] > 0:
                continue
            for k in range(3):
                ray = inverse[k, 0] * u + inverse[k, 1] * v + inverse[k, 2]
                place[k] = ray * depth[v, u]
            for k in range(3):
                a, b, c = level_T_camera[k, 0], level_T_camera[k, 1], level_T_camera[k, 2]
                turned = a * place[0] + b * place[1] + c * place[2]
                xyz[n, k] = turned + level_T_camera[k, 3]
            pixels[n, 0], pixels[n, 1] = u, v
            n += 1
    return xyz, pixels
