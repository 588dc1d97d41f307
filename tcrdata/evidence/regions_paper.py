"""Moving regions as the paper finds them: a level of |dXYZ|, components, boxes, saliency.

Points whose flow passes the paper's cycle test (eq. 5) and that move by more than a level are
joined into components over touching voxels. Which level makes an object is a decision, so regions
are cut at several and keep theirs in `motion_threshold_m`. Center-surround saliency (eq. 10)
compares |dXYZ| inside and around. Two boxes are fitted to each region.

Source: Harley et al., "Track, Check, Repeat" (CVPR 2021), section 3.7.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcrdata.evidence import voxels
from tcrdata.evidence.center_surround import center_surround, shell
from tcrdata.evidence.moving_points import MovingPoints, each_frame
from tcrdata.evidence.moving_regions import Confidence, Region, box_around, region_rows
from tcrdata.types import CueInput, IntArray, Rows

NEEDS: tuple[str, ...] = ("flow", "ground", "motion")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = True
SOURCE = "paper"


@dataclass(frozen=True)
class Settings:
    """How regions are cut. Metres are multiplied by the sequence's metric scale.

    Attributes:
        levels_m: levels of |dXYZ| from one frame to the next at which regions are cut. A rule
            takes the highest at or below the one it asks for; more levels cost a cut each.
        link_voxel_m: moving points are joined when their voxels of this size touch.
        smallest_points: limit of computing: smaller regions are not measured. Looser than any
            rule, for a box and a histogram of fewer points mean nothing.
        shell_m: the surround reaches so far beyond the region's box.
        histogram_bin_m: width of a bin of |dXYZ|.
        histogram_bins: how many bins; the last is open.
        confidence: how motion becomes a confidence.
        frames_per_task: frames a worker takes at once.
    """

    levels_m: tuple[float, ...] = (0.1, 0.2, 0.4, 0.8)
    link_voxel_m: float = 0.5
    smallest_points: int = 6
    shell_m: float = 1.0
    histogram_bin_m: float = 0.1
    histogram_bins: int = 16
    confidence: Confidence = field(default_factory=Confidence)
    frames_per_task: int = 16


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` (source paper, two fits a region) and their `confidences`."""
    settings: Settings = cue.settings
    yield from each_frame(cue, "paper", settings.frames_per_task, measure)


def measure(points: MovingPoints, settings: Settings) -> Iterator[Rows]:
    """Yield the rows of one frame: regions at every level, lowest first."""
    points = points.displaced()
    regions: list[Region] = []
    levels_m = sorted(settings.levels_m)
    for level_m, next_m in zip(levels_m, [*levels_m[1:], None], strict=True):
        # The levels as they were set: a rule names them without the scale.
        levels = {"motion_threshold_m": level_m, "motion_threshold_next_m": next_m}
        for members in cut(points, level_m * points.metric_scale, settings):
            regions.append(Region(members, levels | _measured(points, members, settings)))
    yield from region_rows(points, SOURCE, regions, ("min_area", "l_shape"), settings.confidence)


def cut(points: MovingPoints, level_m: float, settings: Settings) -> list[IntArray]:
    """Return the members of each connected region of points that move by more than a level.

    Args:
        points: of the frame, with known 3D motion.
        level_m: |dXYZ| above which a point moves, metres of this world.
        settings: the voxel and the smallest region.
    """
    moving = np.flatnonzero(points.motion_3d_m > level_m)
    size_m = settings.link_voxel_m * points.metric_scale
    cells = voxels.keys(voxels.voxel_indices(points.xyz[moving], size_m))
    occupied, place = np.unique(cells, return_inverse=True)
    labels = voxels.components(occupied)[place]
    counts = np.bincount(labels, minlength=0)
    large = np.flatnonzero(counts >= settings.smallest_points)
    return [moving[labels == label] for label in large]


def _measured(points: MovingPoints, members: IntArray, settings: Settings) -> dict[str, Any]:
    scale = points.metric_scale
    center = np.zeros(len(points.xyz), dtype=bool)
    center[members] = True
    box, _ = box_around(points.xyz[members], "min_area")
    surround = shell(points.xyz, center, box, settings.shell_m * scale)
    return {
        "center_surround_chi2": center_surround(
            points.motion_3d_m,
            center,
            surround,
            settings.histogram_bin_m * scale,
            settings.histogram_bins,
        ),
    }
