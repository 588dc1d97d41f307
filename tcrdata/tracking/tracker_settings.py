"""When objects are lost, found again, and new."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, TypeVar

from tcrdata.errors import SettingsError
from tcrdata.tracking.assignment import Gates

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")


@dataclass(frozen=True)
class TrackerSettings:
    """When objects are lost, found again, and new; metres are multiplied by the metric scale.

    Attributes:
        near: how far candidates may be from predictions.
        still_m: slower than this, in metres a frame, an object stands.
        link_gate_m: largest distance of what comes into sight from the end of a path.
        misses_frames: without a library, frames after which a target that is not found ends.
        hidden_frames: with one, the longest time out of sight.
        least_passable: mean p of a path that an object may have taken.
        contained_frames: so long after it was lost a target may turn out to be inside another.
        young_frames: a target this young may turn out to be one that came back.
        overlap_iou: a candidate that overlaps a target more is no new one.
        margin_m: a return this much nearer hides what is behind it.
        voxel_m: of the volumes.
        speed_m: a first speed that differs by this, in metres a frame, costs a tenth of p.
    """

    near: Gates = field(default_factory=Gates)
    still_m: float = 0.04
    link_gate_m: float = 1.6
    misses_frames: int = 3
    hidden_frames: int = 40
    least_passable: float = 0.99
    contained_frames: int = 5
    young_frames: int = 5
    overlap_iou: float = 0.1
    margin_m: float = 0.4
    voxel_m: float = 0.4
    speed_m: float = 0.3

    def __post_init__(self) -> None:
        """Refuse what no path can be followed with.

        Raises:
            SettingsError: a time out of sight of no frame, or a length that is not above 0.
        """
        for name in ("misses_frames", "hidden_frames"):
            if getattr(self, name) < 1:
                raise SettingsError(f"track.gates.{name}: at least 1")
        for name in ("voxel_m", "speed_m", "link_gate_m"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"track.gates.{name}: above 0")

    def scaled(self, metric_scale: float) -> TrackerSettings:
        """Return the settings with metres of this world."""
        return replace(_scaled(self, metric_scale), near=_scaled(self.near, metric_scale))


def _scaled(settings: S, metric_scale: float) -> S:
    """Return settings with every field in metres multiplied."""
    metres = {
        f.name: getattr(settings, f.name) * metric_scale
        for f in fields(settings)
        if f.name.endswith("_m")
    }
    return replace(settings, **metres)
