"""What a tracking will do: whose labels, which sequences, with which settings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal

from tcrdata import settings
from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.reports import check_report
from tcrdata.store import Store, Unit
from tcrdata.store.followed import BOXES, stage_of
from tcrdata.tracking.library import LibrarySettings
from tcrdata.tracking.short_range import ShortRangeSettings, TrackerName, short_range
from tcrdata.tracking.tracker_settings import TrackerSettings

Start = Literal["labels", "truth"]


@dataclass(frozen=True)
class Settings:
    """Everything that the numbers of a tracking follow from.

    Attributes:
        tracker: from one frame to the next.
        short: when its matches count.
        gates: of targets and of what is out of sight.
        library: how paths are cut into entries.
        features: what templates are correlated in: `auto` for the newest detector's of these labels
            or earlier ones where there is one, `voxels` for occupancy with colour or reflectance.
        least_truth_points: a true first box with fewer points in it is not begun with.
    """

    tracker: TrackerName = "auto"
    short: ShortRangeSettings = field(default_factory=ShortRangeSettings)
    gates: TrackerSettings = field(default_factory=TrackerSettings)
    library: LibrarySettings = field(default_factory=LibrarySettings)
    features: Literal["auto", "voxels"] = "auto"
    least_truth_points: int = 10


@dataclass(frozen=True)
class TrackPlan:
    """One tracking, fixed before it starts.

    Attributes:
        selection_id: whose labels.
        round: EM round of the selection.
        start: what tracklets begin with; `truth` is for evaluation alone.
        library: whether the long range uses the library.
        settings: of the trackers.
        model: id of the detector whose features are correlated; empty for none.
        entries: parameters of the rule that lets paths into the library.
        sequences: (dataset, sequence), in order.
    """

    selection_id: str
    round: int
    start: Start
    library: bool
    settings: Settings
    model: str
    entries: Mapping[str, Any]
    sequences: tuple[tuple[str, str], ...]


def plan_tracking(
    store: Store,
    selection_id: str,
    *,
    start: Start = "labels",
    library: bool = True,
    tracker: TrackerName = "auto",
    assignments: Mapping[str, str] | None = None,
    detector: str | None = None,
) -> TrackPlan:
    """Return the plan of a tracking.

    Args:
        store: holds the selection.
        selection_id: whose labels are tracked; from truth, whose labels are candidates.
        start: what tracklets begin with.
        library: whether what is lost is looked for along the library's paths.
        tracker: nearest, correlation or auto.
        assignments: `name=value` of the settings; `library_entries.name=value` of the rule.
        detector: id of the one whose features are correlated, empty for none; the newest of these
            labels or earlier ones when None.

    Raises:
        SettingsError: an unknown name or value.
        MissingEvidenceError: the selection has no label, or truth has no labelled object.
    """
    values = {"tracker": tracker, **dict(assignments or {})}
    rule = {k: values.pop(k) for k in list(values) if k.startswith("library_entries.")}
    chosen = _overridden(Settings(), values, "track")
    short_range(chosen.tracker, chosen.short)
    rows = store.read("selections", selection_id=selection_id).to_pylist()
    sequences = _sequences(store, selection_id, start)
    if detector is None:
        detector = detector_of(store, rows[0]["round"])
    return TrackPlan(
        selection_id, rows[0]["round"], start, library, chosen,
        detector if chosen.features == "auto" else "",
        _entries(rule), sequences,
    )  # fmt: skip


def _entries(assignments: Mapping[str, str]) -> dict[str, float]:
    """Return the parameters of the rule for entries from `library_entries.name=value`."""
    found = {}
    for name, text in assignments.items():
        try:
            found[name.partition(".")[2]] = float(text)
        except ValueError as error:
            raise SettingsError(f"{name}={text}: a number is needed") from error
    if found:
        check_report("library_entries", found, folder="tracking")
    return found


def detector_of(store: Store, round: int) -> str:
    """Return the id of the newest finished detector of no later round's labels; empty: none."""
    names = ["model_id", "kind", "labels_round", "finished"]
    rows = store.read("models", columns=names).to_pylist()
    own = [
        (row["labels_round"], row["model_id"])
        for row in rows
        if row["kind"] == "detector" and row["finished"] and row["labels_round"] <= round
    ]
    return str(max(own)[1]) if own else ""


def _overridden(own: Any, values: Mapping[str, str], where: str) -> Any:
    """Return settings of settings with `group.name=value` applied."""
    plain = {name: text for name, text in values.items() if "." not in name}
    groups: dict[str, dict[str, str]] = defaultdict(dict)
    for name, text in values.items():
        if "." in name:
            group, _, inner = name.partition(".")
            groups[group][inner] = text
    for group, rest in groups.items():
        if not is_dataclass(getattr(own, group, None)):
            known = [f.name for f in fields(own) if is_dataclass(getattr(own, f.name))]
            raise SettingsError(
                settings.unknown(f"group of settings '{where}.{group}'", group, known)
            )
        own = replace(own, **{group: _overridden(getattr(own, group), rest, f"{where}.{group}")})
    return settings.overridden(own, plain, where)


def _sequences(store: Store, selection_id: str, start: Start) -> tuple[tuple[str, str], ...]:
    """Return the sequences that have anything to begin with."""
    table = "ground_truth" if start == "truth" else "labels"
    columns = ["dataset", "sequence"]
    if start == "truth":
        found = store.read(table, columns=columns)
    else:
        found = store.read(table, columns=columns, selection_id=selection_id, state="positive")
    keys = sorted({(row["dataset"], row["sequence"]) for row in found.to_pylist()})
    if not keys:
        raise MissingEvidenceError(
            "no sequence of this store has labelled objects to begin with: build with ground truth "
            "beside the data, or leave --init-from out"
            if start == "truth"
            else f"selection {selection_id[:12]} has no label to track: loosen a rule with "
            "`tcrdata check`, or look at `tcrdata funnel`"
        )
    return tuple(keys)


def passes(plan: TrackPlan) -> list[tuple[bool, Start]]:
    """Return whether each pass over the sequences uses the library, and what it begins with.

    Short range on the labels always comes first where a library is wanted.
    """
    passes: list[tuple[bool, Start]] = []
    if plan.library:
        passes.append((False, "labels"))
    passes.append((plan.library, plan.start))
    return passes


def units_of(plan: TrackPlan) -> list[Unit]:
    """Return the units of work of a tracking, in order."""
    parts = [replace(plan, library=library, start=start) for library, start in passes(plan)]
    units = [unit_of(part, *key) for part in parts for key in plan.sequences]
    if plan.start == "labels":
        units += [boxes_of(plan, *key) for key in plan.sequences]
    return units


def boxes_of(plan: TrackPlan, dataset: str, sequence: str) -> Unit:
    """Return the unit of the proposals that one sequence's tracklets are."""
    return Unit(stage_of(BOXES, plan.selection_id), dataset, sequence, plan.round)


def unit_of(plan: TrackPlan, dataset: str, sequence: str) -> Unit:
    """Return the unit of work of one sequence."""
    stage = "tracklets" if plan.start == "labels" else "truth_tracklets"
    kind = stage + ("_library" if plan.library else "")
    return Unit(stage_of(kind, plan.selection_id), dataset, sequence, plan.round)
