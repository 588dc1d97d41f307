"""Stages that follow a selection's labels over time: each selection's rows lie beside the others'.

Boxes that tracking adds are proposals; a preset takes those of the labels that its header names in
`-- follows:`, and no other selection reads any: what is tracked changes no selection made before.
"""

from __future__ import annotations

from collections.abc import Iterable

from tcrdata.store.store import Store

BOXES = "tracklet_boxes"
"""Stage of the proposals that tracklets are, with the id of the selection after it."""

TRACKED = ("tracklets", "tracklets_library", "truth_tracklets", "truth_tracklets_library")
"""Stages of tracklets, with the id of the selection after them, too."""


def stage_of(kind: str, selection_id: str) -> str:
    """Return the stage of what is made from a selection's labels."""
    return f"{kind}-{selection_id}"


def is_read(stage: str, followed: str | None) -> bool:
    """Whether a selection reads a stage's rows: of added boxes those of whom it follows alone."""
    kind = stage.partition("-")[0]
    return kind != BOXES or (followed is not None and stage == stage_of(BOXES, followed))


def tracked_selections(store: Store, kinds: Iterable[str] = TRACKED) -> set[str]:
    """Return the ids of the selections of whose labels a store has stages of some kinds."""
    stages = (record.unit.stage.partition("-") for record in store.records())
    return {selection_id for kind, _, selection_id in stages if kind in kinds}


def newest_tracked(store: Store, preset: str, round: int) -> str | None:
    """Return the id of a preset's newest selection of a round with added boxes; None without."""
    rows = store.read("selections", columns=["selection_id"], preset=preset, round=round)
    among = rows["selection_id"].to_pylist()
    return store.newest_selection(among=tracked_selections(store, (BOXES,)).intersection(among))
