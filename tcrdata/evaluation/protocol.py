"""How labels are scored: the settings, and the text that says so before any number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from tcrdata.errors import SettingsError

View = Literal["bev", "2d"]
VIEWS: tuple[View, ...] = ("bev", "2d")


@dataclass(frozen=True)
class Settings:
    """The scoring protocol, beside the parameters of `queries/reports/evaluation_objects.sql`.

    Attributes:
        ious: thresholds of overlap, rising.
        moving_only: report the moving objects alone; their speeds must be known.
        dont_care_views: views in which unmatched labels inside DontCare regions are left out;
            KITTI's devkit does so in the image alone, since the regions have no 3D box.
        dont_care_share: how much of a label's 2D box one region must cover for that.
        leave_out_unscored: a label on an object that is hidden or outside the region is left out;
            else it is wrong.
        parameters: name and value of query parameters to replace: the region, sources, states.
        frames_a_pass: frames that are held in memory together, at most, or one sequence.
    """

    ious: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    moving_only: bool = False
    dont_care_views: tuple[View, ...] = ("2d",)
    dont_care_share: float = 0.5
    leave_out_unscored: bool = True
    parameters: tuple[tuple[str, Any], ...] = ()
    frames_a_pass: int = 2000

    def __post_init__(self) -> None:
        if not self.ious or list(self.ious) != sorted(set(self.ious)):
            raise SettingsError(f"ious {self.ious} must be thresholds that rise: give e.g. 0.5,0.7")
        if not all(0 < iou <= 1 for iou in self.ious):
            raise SettingsError(f"ious {self.ious} must lie above 0 and at most at 1")
        unknown = [view for view in self.dont_care_views if view not in VIEWS]
        if unknown:
            raise SettingsError(f"dont_care_views has '{unknown[0]}': the views are bev and 2d")

    @property
    def variants(self) -> tuple[tuple[View, bool], ...]:
        """View and whether DontCare regions count, the reported ones first."""
        reported = [(view, view in self.dont_care_views) for view in VIEWS]
        return tuple(reported + [(view, False) for view, regions in reported if regions])


def describe(settings: Settings, parameters: Mapping[str, str]) -> str:
    """Return the protocol in plain lines.

    Args:
        settings: as used.
        parameters: every parameter of the query with its value, as text.
    """
    p = parameters
    sources = "every source" if p["scored_sources"] == "NULL" else f"sources {p['scored_sources']}"
    regions = " and ".join(settings.dont_care_views) or "no view"
    unscored = "left out" if settings.leave_out_unscored else "wrong"
    return "\n".join(
        (
            f"Predictions: labels in state {p['scored_state']}, {sources}; class-agnostic.",
            "Truth: labelled objects of the frames that were built, in sequences that have any.",
            f"Region: |x| <= {p['max_lateral_m']} m and {p['min_depth_m']} <= z <= "
            f"{p['max_depth_m']} m, times the metric scale (LiDAR only); 3D centre inside the "
            f"image; objects that show fewer than {p['min_visible_px']} pixels are hidden. "
            f"A label outside the region is left out; one on a hidden or outside object is "
            f"{unscored}.",
            "Overlap: bev = rotated footprints, a round object takes the label's yaw, a tilted one "
            "its corners' hull; 2d = boxes in the image.",
            "Matching: in each frame the surest label first takes the free object it overlaps "
            "most, one to one.",
            f"DontCare: unmatched labels covered by one region to {settings.dont_care_share:.0%} "
            f"or more are left out in {regions}.",
            "AP: VOC, area under the precision envelope, labels of equal score together; "
            "ap_per_frame = mean over frames, without the frames that have neither truth nor "
            "label (the released code of Track, Check, Repeat scores those 0); "
            "ap_pooled = all frames as one list.",
            f"moving: objects faster than {p['moving_above_mps']} m/s times the metric scale; "
            "labels on other objects are left out of its AP; its recall is on moving objects, its "
            "precision on all.",
        )
    )
