"""The pixels of labels: their proposals' masks, else the hulls of their points in the image."""

from __future__ import annotations

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.exporters.cameras import camera_poses
from tcrdata.exporters.frame_points import FramePoints
from tcrdata.exporters.labels import SequenceLabels
from tcrdata.geometry.hulls import hull_pixels
from tcrdata.store.arrays import encode_mask
from tcrdata.store.table_arrays import columns, matrices
from tcrdata.types import BoolArray, FloatArray, IntArray

_NEAREST_M = 0.01


def label_masks(part: SequenceLabels, kept: BoolArray) -> dict[str, str]:
    """Return the COCO run-length string of each label that has pixels, by its proposal.

    Args:
        part: with `exported_masks.sql` beside it; where that gives points, they are read.
        kept: (N,) the labels that matter.

    Raises:
        FrameError: the points are gone since the build, or others.
    """
    if part.beside is None:
        return {}
    rows = part.beside.select(["proposal_id", "mask", "point_indices"]).to_pylist()
    found = {row["proposal_id"]: row["mask"] for row in rows if row["mask"] is not None}
    members = {
        row["proposal_id"]: np.array(row["point_indices"]) for row in rows if row["point_indices"]
    }
    return found | (_hulls(part, kept, members) if members else {})


def _hulls(part: SequenceLabels, kept: BoolArray, members: dict[str, IntArray]) -> dict[str, str]:
    """Return the masks of labels by the indices of their points."""
    names = part.labels["proposal_id"].to_pylist()
    projections = matrices(part.frames, "projection", (3, 4)) @ camera_poses(part)
    sizes = columns(part.frames, ("width_px", "height_px"))
    points = FramePoints(part)
    found = {}
    for row, labels in part.by_frame():
        own = [n for n in range(labels.start, labels.stop) if kept[n] and names[n] in members]
        if not own:
            continue
        pixels = _pixels(points.level(row), projections[row], sizes[row])
        for name in (names[n] for n in own):
            if members[name].max() >= len(pixels):
                raise FrameError(
                    f"the points of '{name}' are others than the build saw: build again, or add "
                    "--labels-only"
                )
            inside = pixels[members[name]]
            inside = inside[~np.isnan(inside[:, 0])]
            if len(inside):
                size = sizes[row].astype(int).tolist()
                found[name] = encode_mask(hull_pixels(inside.astype(np.int64), *size))
    return found


def _pixels(xyz: FloatArray, projection: FloatArray, size: FloatArray) -> FloatArray:
    """Return (N, 2) column and row of level points, NaN for those outside the image."""
    found = xyz @ projection[:, :3].T + projection[:, 3]
    ahead = found[:, 2] > _NEAREST_M
    pixels: FloatArray = np.rint(found[:, :2] / np.where(ahead, found[:, 2], np.nan)[:, None])
    inside = np.all((pixels >= 0) & (pixels < size), axis=1, keepdims=True)
    return np.where(inside, pixels, np.nan)
