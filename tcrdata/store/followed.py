"""Stages that follow a selection's labels over time: each selection's rows lie beside the others'.

Boxes that tracking adds are proposals; a preset takes those of the labels that its header names in
`-- follows:`, and no other selection reads any: what is tracked changes no selection made before.
"""

from __future__ import annotations

from collections.abc import Iterable

from tcrdata.errors import MissingEvidenceError, SettingsError
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


def check_followed(store: Store, selection_id: str, preset: str, round: int) -> None:
    """Check that a selection's added boxes are there, and those that a preset follows.

    Args:
        store: holds the selection.
        selection_id: of it.
        preset: name of the preset that it must be of.
        round: EM round that it must be of.

    Raises:
        SettingsError: it is of another preset or round.
        MissingEvidenceError: it was not tracked.
    """
    (row,) = store.read("selections", selection_id=selection_id).to_pylist()
    called = f"selection {selection_id[:12]} '{row['name']}'"
    if (row["preset"], row["round"]) != (preset, round):
        raise SettingsError(
            f"{called} is of preset {row['preset']} and round {row['round']}: name one of preset "
            f"{preset} and round {round}, which are followed here"
        )
    if selection_id not in tracked_selections(store, (BOXES,)):
        raise MissingEvidenceError(
            f"the labels of {called} were not tracked: run tcrdata track --store {store.url} "
            f"--selection {selection_id[:12]}"
        )
