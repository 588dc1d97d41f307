"""What the scores of tracking are, and the protocol behind them in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from tcrdata.evaluation.identity import IdentityScores


@dataclass(frozen=True)
class TrackingSettings:
    """The protocol.

    Attributes:
        frames: overlap is reported for so many frames from the start.
        iou: overlap of a box that is on an object.
        returned_frames: after so many frames in sight again an object counts as recovered.
        hidden_px: fewer visible pixels than this are out of sight.
    """

    frames: int = 20
    iou: float = 0.5
    returned_frames: int = 3
    hidden_px: int = 50


@dataclass(frozen=True)
class Curve:
    """Mean overlap with the object that a tracklet began on.

    Attributes:
        kind: truth_tracklet or truth_tracklet_library.
        subset: all, or those that moved meanwhile.
        iou: mean overlap 0, 1, ... frames after the start; None where nothing is scored.
        objects: how many are scored at each.
    """

    kind: str
    subset: str
    iou: tuple[float | None, ...]
    objects: tuple[int, ...]


@dataclass(frozen=True)
class Ends:
    """Whether tracklets hold their object from the first to the last frame.

    Attributes:
        kind: which tracklets.
        recall: share of objects that one tracklet is on in the first and in the last frame.
        recall_throughout: the same, and in every scored frame between.
        precision: share of tracklets that end on the object that they began on.
        objects: scored.
        tracklets: that began on a labelled object.
    """

    kind: str
    recall: float | None
    recall_throughout: float | None
    precision: float | None
    objects: int
    tracklets: int


@dataclass(frozen=True)
class Recovery:
    """Objects that came back into sight.

    Attributes:
        kind: truth_tracklet or truth_tracklet_library.
        how: behind (passed behind another) or contained (inside another's box).
        returns: how often that happened.
        recovered: how often the tracklet was on the object some frames later.
    """

    kind: str
    how: str
    returns: int
    recovered: int


@dataclass(frozen=True)
class TrackingEvaluation:
    """All scores of tracking.

    Attributes:
        protocol: how it was scored, in plain lines.
        curves: overlap over time.
        ends: first to last.
        recoveries: after occlusions.
        identity: HOTA, CLEAR and identity scores; empty without the package trackeval.
        without_identity: why there are none; None when there are.
    """

    protocol: str
    curves: tuple[Curve, ...]
    ends: tuple[Ends, ...]
    recoveries: tuple[Recovery, ...]
    identity: tuple[IdentityScores, ...]
    without_identity: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return plain lists, dicts, numbers and text."""
        return asdict(self)


def describe_tracking(own: TrackingSettings) -> str:
    """Return the protocol in plain lines."""
    return "\n".join(
        (
            "Truth: labelled objects in frames that were built, inside the region of `evaluate`; "
            f"one that shows fewer than {own.hidden_px} pixels is hidden. Overlap: rotated "
            "footprints, as in `evaluate`.",
            f"Overlap over time: from the true first box, {own.frames} frames; frames in which the "
            "object is hidden or outside are left out, a tracklet that has ended scores 0.",
            f"First to last: recall = objects that one tracklet is on (IoU {own.iou}) in their "
            "first and last scored frame; precision = tracklets that end on the object that they "
            "began on, of those that began on any.",
            f"Recovered: IoU {own.iou} {own.returned_frames} frames after an object came back into "
            "sight.",
            "HOTA, CLEAR and identity: TrackEval's, on footprints; CLEAR and identity at IoU "
            f"{own.iou}. Boxes on hidden or outside objects, and outside the region, are left out.",
        )
    )
