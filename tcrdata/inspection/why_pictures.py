"""The picture of a proposal that `why` draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tcrdata import registry
from tcrdata.errors import MissingEvidenceError
from tcrdata.ingest import frames_of
from tcrdata.pictures import read_votes
from tcrdata.store import Store
from tcrdata.types import BOX_COLUMNS

if TYPE_CHECKING:
    from tcrdata.inspection.why import Explanation
    from tcrdata.views.why_picture import Surroundings

_KINDS = {"positive": "labels", "ignore": "ignored"}


def draw_why(store: Store, found: Explanation) -> bytes:
    """Return a PNG: the proposal in the image and from above, and every rule's margin.

    Args:
        store: that holds it; its dataset must still be where the build read it.
        found: the proposal, explained.

    Raises:
        MissingEvidenceError: the store no longer holds the proposal's frame.
        DatasetError: the dataset cannot be read.
    """
    from tcrdata.views.why_picture import RuleBar, why_picture

    row = found.proposal
    others: dict[str, list[Any]] = {"labels": [], "ignored": []}
    for label in found.labels:
        others[_KINDS[label["state"]]].append([label[name] for name in BOX_COLUMNS])
    bars = [
        RuleBar(r.rule, r.verdict, r.margin, r.says, r.stops or r.tightest) for r in found.rules
    ]
    stopping = [rule.rule + " alone" * rule.alone for rule in found.rules if rule.stops]
    stopped = ", stopped by " * bool(stopping) + ", ".join(stopping)
    return why_picture(
        _surroundings(store, row),
        np.array([row[name] for name in BOX_COLUMNS]),
        found.points,
        {kind: np.array(boxes).reshape(-1, 7) for kind, boxes in others.items()},
        bars,
        (row["proposal_id"], f"selection '{found.selection}': {found.outcome}{stopped}"),
    )


def _surroundings(store: Store, row: Mapping[str, Any]) -> Surroundings:
    """The image and the points of a proposal's frame."""
    from tcrdata.views.why_picture import Surroundings

    keys = {"dataset": row["dataset"], "sequence": row["sequence"]}
    (info,) = store.read("sequences", round=row["round"], **keys).to_pylist()
    dataset = registry.find("datasets", row["dataset"]).open_dataset(info["root"])
    frame = next((f for f in frames_of(store, **keys) if f.frame == row["frame"]), None)
    if frame is None:
        raise MissingEvidenceError(
            f"{store.url}: frame {row['frame']} of {row['dataset']}/{row['sequence']} is no longer "
            "in the store: build it again"
        )
    return Surroundings(
        dataset.read_image(frame) if frame.has_image else None,
        frame.level_projection,
        dataset.read_points(frame).xyz,
        read_votes(store, frame),
        info["metric_scale"],
    )
