"""Regions of an image from the few pixels that are known of them."""

from __future__ import annotations

import numpy as np

from tcrdata.types import BoolArray, IntArray


def hull_pixels(pixels: IntArray, width: int, height: int) -> BoolArray:
    """Return which pixels the convex hull of some covers, its sides included.

    Points are sparse in the image: their hull is the region, as the released code has it.

    Args:
        pixels: (K, 2) column, row; K > 0.
        width: of the image.
        height: of the image.

    Returns:
        (height, width), in Fortran's order: run-lengths go down the columns.
    """
    import cv2

    # Drawn on its side, and so nothing has to be turned over.
    mask = np.zeros((width, height), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(pixels[:, ::-1].astype(np.int32)), 1)
    return mask.T.view(np.bool_)
