"""Moving regions as the released code finds them: voxels whose flow the egomotion does not explain.

Points whose flow passes the release's cycle test fall into voxels of 0.125 m. A: the flow points
elsewhere than the egomotion's flow (cosine < 0.8). B: it differs by more than 8 px. Voxels that
touch one of a point that moves with the egomotion (|dXYZ| within RANSAC's inlier radius) are
explained and leave both. Components of B, over faces, edges and corners, are the regions; their
sizes are columns, so that the tests on them can be rules. Boxes are minimum-area rectangles.

Source: the released code of Harley et al., "Track, Check, Repeat" (CVPR 2021). It crops the world
to +-16 m and 2 to 34 m ahead; here a rule on the box's place can do so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcrdata.evidence import voxels
from tcrdata.evidence.moving_points import MovingPoints, each_frame
from tcrdata.evidence.moving_regions import Confidence, Region, region_rows
from tcrdata.evidence.point_flow import project
from tcrdata.types import CueInput, IntArray, Rows

NEEDS: tuple[str, ...] = ("flow", "ground", "motion")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = True
SOURCE = "release"


@dataclass(frozen=True)
class Settings:
    """How regions are cut. Metres are multiplied by the sequence's metric scale.

    Cosine and pixels are the released code's definition of its two voxel sets, which rules then
    count: looser ones would join regions with their surroundings, and be another method.

    Attributes:
        voxel_m: side of a voxel.
        cosine_below: A: cosine of flow and egomotion flow.
        residual_above_px: B: |flow - egomotion flow|.
        explained_m: |dXYZ| up to which the egomotion explains a point: RANSAC's inlier radius.
        smallest_voxels: limit of computing: components of B with fewer voxels are not measured.
            Looser than any rule.
        confidence: how motion becomes a confidence.
        frames_per_task: frames a worker takes at once.
    """

    voxel_m: float = 0.125
    cosine_below: float = 0.8
    residual_above_px: float = 8.0
    explained_m: float = 0.25
    smallest_voxels: int = 4
    confidence: Confidence = field(default_factory=Confidence)
    frames_per_task: int = 16


@dataclass(frozen=True)
class Cut:
    """A component of B.

    Attributes:
        members: (K,) places of the points in its voxels, rising.
        voxels_a: (A, 3) its voxels that are in A too.
        voxels_b: (B, 3) its voxels.
    """

    members: IntArray
    voxels_a: IntArray
    voxels_b: IntArray


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` (source release) and their `confidences`."""
    settings: Settings = cue.settings
    yield from each_frame(cue, "release", settings.frames_per_task, measure)


def measure(points: MovingPoints, settings: Settings) -> Iterator[Rows]:
    """Yield the rows of one frame, the largest region first."""
    cuts = sorted(cut(points, settings), key=lambda found: -len(found.voxels_b))
    voxel_m = settings.voxel_m * points.metric_scale
    regions = [
        Region(found.members, _measured(points, found, n + 1, voxel_m))
        for n, found in enumerate(cuts)
    ]
    yield from region_rows(points, SOURCE, regions, ("min_area",), settings.confidence)


def cut(points: MovingPoints, settings: Settings) -> list[Cut]:
    """Return the components of B, in the order of their first voxel."""
    cells = voxels.keys(voxels.voxel_indices(points.xyz, settings.voxel_m * points.metric_scale))
    explained = points.motion_3d_m <= settings.explained_m * points.metric_scale
    candidates = np.flatnonzero(points.motion_2d_px > settings.residual_above_px)
    static = np.unique(cells[explained])
    candidates = candidates[~voxels.touching(cells[candidates], static)]
    voxels_a = np.unique(cells[points.cosine < settings.cosine_below])
    voxels_b, place = np.unique(cells[candidates], return_inverse=True)
    labels = voxels.components(voxels_b)
    also_a = voxels.is_in(voxels_b, voxels_a)
    large = np.flatnonzero(np.bincount(labels) >= settings.smallest_voxels)
    return [
        Cut(
            candidates[labels[place] == label],
            voxels.from_keys(voxels_b[(labels == label) & also_a]),
            voxels.from_keys(voxels_b[labels == label]),
        )
        for label in large
    ]


def _measured(points: MovingPoints, found: Cut, rank: int, voxel_m: float) -> dict[str, Any]:
    sides = found.voxels_b.max(axis=0) - found.voxels_b.min(axis=0)
    side_px, covered_px = _projected(points, (found.voxels_a + 0.5) * voxel_m)
    return {
        "voxels_a": len(found.voxels_a),
        "voxels_b": len(found.voxels_b),
        # As the released code has it: last voxel - first, so 0 for a region one voxel thick.
        "smallest_side_voxels": int(sides.min()),
        "smallest_side_px": side_px,
        "projected_px": covered_px,
        "size_rank": rank,
    }


def _projected(points: MovingPoints, centers: np.ndarray) -> tuple[float, int]:
    """Return the smaller side and the number of the pixels that voxel centres project to."""
    uv, _ = project(centers, points.projection)
    pixels = np.floor(uv[np.isfinite(uv).all(axis=1)] + 0.5)
    width, height = points.size_px
    pixels = pixels[((pixels >= 0) & (pixels < (width, height))).all(axis=1)]
    if not len(pixels):
        return 0.0, 0
    sides = pixels.max(axis=0) - pixels.min(axis=0) + 1
    return float(sides.min()), len(np.unique(pixels, axis=0))
