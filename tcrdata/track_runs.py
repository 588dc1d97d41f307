"""Tracking of a store's sequences: units of work that read labels and leave tracklets.

Short range alone comes first, in every sequence: what it finds is what the library is chosen from.
With the library, every sequence is then tracked once more, and the long range links what came back.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal

from tcrdata import __version__, registry, settings
from tcrdata.errors import DatasetError, EvidenceError, MissingEvidenceError, SettingsError
from tcrdata.executors import Processes, Serial, executor
from tcrdata.outcomes import UnitOutcome
from tcrdata.plan import ROUND
from tcrdata.reports import run_report
from tcrdata.store import Store, Unit, open_store
from tcrdata.tracked_rows import BOX, RowMaker, columns_of
from tcrdata.tracked_scenes import SceneSource, scene_source
from tcrdata.tracklet_boxes import STAGE as BOXES
from tcrdata.tracklet_boxes import write_boxes
from tcrdata.tracking.library import LibrarySettings, library_of_rows
from tcrdata.tracking.short_range import ShortRangeSettings, TrackerName, short_range
from tcrdata.tracking.tracker import Tracker, TrackerSettings
from tcrdata.types import FloatArray

Start = Literal["labels", "truth"]
_LABEL_COLUMNS = ("proposal_id", "frame", "state", "score", "source", "track_id", *BOX)
_ROWS_AT_ONCE = 4096


@dataclass(frozen=True)
class Settings:
    """Everything that the numbers of a tracking follow from.

    Attributes:
        tracker: from one frame to the next.
        short: when its matches count.
        gates: of targets and of what is out of sight.
        library: how paths are cut into entries.
        least_truth_points: a true first box with fewer points in it is not begun with.
    """

    tracker: TrackerName = "auto"
    short: ShortRangeSettings = field(default_factory=ShortRangeSettings)
    gates: TrackerSettings = field(default_factory=TrackerSettings)
    library: LibrarySettings = field(default_factory=LibrarySettings)
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
        entries: parameters of the rule that lets paths into the library.
        sequences: (dataset, sequence), in order.
    """

    selection_id: str
    round: int
    start: Start
    library: bool
    settings: Settings
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
) -> TrackPlan:
    """Return the plan of a tracking.

    Args:
        store: holds the selection.
        selection_id: whose labels are tracked; from truth, whose labels are candidates.
        start: what tracklets begin with.
        library: whether what is lost is looked for along the library's paths.
        tracker: nearest, correlation or auto.
        assignments: `name=value` of the settings; `library_entries.name=value` of the rule.

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
    return TrackPlan(
        selection_id, rows[0]["round"], start, library, chosen,
        {name.partition(".")[2]: float(text) for name, text in rule.items()}, sequences,
    )  # fmt: skip


def _overridden(own: Any, values: Mapping[str, str], where: str) -> Any:
    """Return settings of settings with `group.name=value` applied."""
    plain = {name: text for name, text in values.items() if "." not in name}
    groups: dict[str, dict[str, str]] = defaultdict(dict)
    for name, text in values.items():
        if "." in name:
            group, _, rest = name.partition(".")
            groups[group][rest] = text
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
            "no sequence of this store has labelled objects to begin with"
            if start == "truth"
            else f"selection {selection_id[:12]} has no label to track: loosen a rule with "
            "`tcrdata check`, or look at `tcrdata funnel`"
        )
    return tuple(keys)


def track(
    store_url: str, plan: TrackPlan, *, workers: int, progress: Callable[[UnitOutcome], None]
) -> list[UnitOutcome]:
    """Make what is missing of a tracking.

    Raises:
        TcrdataError: the store cannot be read or written.
    """
    outcomes = []
    for library, start in _passes(plan):
        store = open_store(store_url)
        entries = _library_rows(store, plan) if library else []
        part = replace(plan, library=library, start=start)
        for outcome in _outcomes(store_url, part, entries, workers):
            progress(outcome)
            outcomes.append(outcome)
    if plan.start == "labels":
        for outcome in _boxes(store_url, plan, outcomes):
            progress(outcome)
            outcomes.append(outcome)
    return outcomes


def _boxes(store_url: str, plan: TrackPlan, tracked: list[UnitOutcome]) -> Iterator[UnitOutcome]:
    """Let the tracklets be proposals, too: rules may take their boxes for labels."""
    failed = {(o.unit.dataset, o.unit.sequence) for o in tracked if o.state == "failed"}
    for key in plan.sequences:
        if key in failed:
            continue
        store = open_store(store_url)
        made = write_boxes(store, unit_of(plan, *key), library=plan.library)
        unit = Unit(BOXES, *key, plan.round)
        yield UnitOutcome(unit, "made" if made else "done")


def _passes(plan: TrackPlan) -> list[tuple[bool, Start]]:
    """Short range on the labels always comes first where a library is wanted."""
    passes: list[tuple[bool, Start]] = []
    if plan.library:
        passes.append((False, "labels"))
    passes.append((plan.library, plan.start))
    return passes


def number_of_units(plan: TrackPlan) -> int:
    """Return how many units of work a tracking has."""
    passes = len(_passes(plan)) + (plan.start == "labels")
    return passes * len(plan.sequences)


def _outcomes(
    store_url: str, plan: TrackPlan, entries: list[dict[str, Any]], workers: int
) -> Iterator[UnitOutcome]:
    """Track sequences side by side; rows do not depend on how many at once."""
    tasks = [(store_url, plan, entries, *key) for key in plan.sequences]
    alone = workers < 2 or len(tasks) < 2 or store_url.startswith("memory")
    with executor(1 if alone else workers) as parallel:
        assert isinstance(parallel, Serial | Processes)
        yield from parallel(_track_sequence, tasks)


def unit_of(plan: TrackPlan, dataset: str, sequence: str) -> Unit:
    """Return the unit of work of one sequence."""
    stage = "tracklets" if plan.start == "labels" else "truth_tracklets"
    return Unit(stage + ("_library" if plan.library else ""), dataset, sequence, plan.round)


def _track_sequence(
    task: tuple[str, TrackPlan, list[dict[str, Any]], str, str],
) -> UnitOutcome:
    url, plan, entries, dataset, sequence = task
    store = open_store(url)
    unit = unit_of(plan, dataset, sequence)
    labels = _labels(store, plan.selection_id, dataset, sequence)
    inputs = _inputs(store, plan, unit, labels, entries)
    plain = {"version": __version__, "settings": settings.as_plain(plan.settings)}
    hash_ = settings.digest(plain)
    if store.is_done(unit, hash_, inputs):
        return UnitOutcome(unit, "done")
    try:
        source = scene_source(store, _dataset(store, dataset, sequence), dataset, sequence, labels)
        with store.writer(unit, settings_hash=hash_, inputs=inputs) as writer:
            for table, columns in _rows(store, plan, source, unit, entries):
                writer.append(table, columns)
    except (DatasetError, EvidenceError, MissingEvidenceError) as error:
        return UnitOutcome(unit, "failed", str(error))
    return UnitOutcome(unit, "made")


def _dataset(store: Store, dataset: str, sequence: str) -> Any:
    rows = store.read("sequences", columns=["root"], dataset=dataset, sequence=sequence)
    if not rows.num_rows:
        raise MissingEvidenceError(f"{dataset}/{sequence} is not in the store: build it first")
    return registry.find("datasets", dataset).open_dataset(rows["root"][0].as_py())


def _labels(store: Store, selection_id: str, dataset: str, sequence: str) -> list[dict[str, Any]]:
    rows = store.read(
        "labels", columns=list(_LABEL_COLUMNS), dataset=dataset, sequence=sequence,
        selection_id=selection_id,
    )  # fmt: skip
    found: list[dict[str, Any]] = rows.to_pylist()
    return sorted(found, key=lambda row: (row["frame"], -row["score"], row["proposal_id"]))


def _inputs(
    store: Store, plan: TrackPlan, unit: Unit, labels: list[dict[str, Any]], entries: list[Any]
) -> dict[str, str]:
    """Return digests of what a unit's rows follow from: content, not names of selections."""
    inputs = {"labels": settings.digest(labels)}
    stages = ["frames", "ground", "odometry"]
    stages += ["ground_truth"] if plan.start == "truth" else []
    for stage in stages:
        record = store.record(Unit(stage, unit.dataset, unit.sequence, ROUND))
        inputs[stage] = record.digest if record else "missing"
    if plan.library:
        inputs["library"] = settings.digest(entries)
    return inputs


def _library_rows(store: Store, plan: TrackPlan) -> list[dict[str, Any]]:
    """Return what the rule lets into the library, of the round's tracklets."""
    connection = store.connect(tables=("trajectories",))
    try:
        found = run_report(connection, "library_entries", dict(plan.entries), folder="tracking")
        rows: list[dict[str, Any]] = found.to_arrow_table().to_pylist()
    finally:
        connection.close()
    return [row for row in rows if row["round"] == plan.round]


def _rows(
    store: Store,
    plan: TrackPlan,
    source: SceneSource,
    unit: Unit,
    entries: list[dict[str, Any]],
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Track one sequence; yields batches of rows."""
    table = "tracklets" if plan.start == "labels" else "truth_tracklets"
    with_paths = plan.start == "labels" and not plan.library
    maker = RowMaker(
        source.world,
        source.tables,
        f"{unit.dataset}/{unit.sequence}/{table.removesuffix('s')}",
        source.metric_scale,
        {"library": plan.library, "tracker": plan.settings.tracker},
        settings=plan.settings.library if with_paths else None,
    )
    waiting: dict[str, list[dict[str, Any]]] = defaultdict(list)
    yield table, {}
    if with_paths:
        yield "trajectories", {}
    starts = _starts(store, plan, source, unit)
    for finished in _followed(plan, source, maker, entries, starts):
        waiting[table] += maker.tracklet_rows(finished)
        waiting["trajectories"] += maker.trajectory_rows(finished.number, over=finished.over)
        for name, rows in waiting.items():
            if len(rows) > _ROWS_AT_ONCE:
                yield name, columns_of(rows)
                rows.clear()
    for name, rows in waiting.items():
        if rows:
            yield name, columns_of(rows)


def _followed(
    plan: TrackPlan,
    source: SceneSource,
    maker: RowMaker,
    entries: list[dict[str, Any]],
    starts: dict[int, list[tuple[str, FloatArray]]] | None,
) -> Iterator[Any]:
    """Yield what trackers hand on; where egomotion has a break, a new one begins."""
    own, scale = plan.settings, source.metric_scale
    short = short_range(
        own.tracker, replace(own.short, correlation=own.short.correlation.scaled(scale))
    )
    library = library_of_rows(entries, scale) if plan.library else None
    tracker: Tracker | None = None
    segment, number = -1, 0
    for scene, proposals in source.scenes():
        here = source.world.poses.segment[scene.frame]
        if tracker is None or here != segment:
            if tracker is not None:
                yield from tracker.finish()
                number = tracker.next_number
            tracker = Tracker(
                short, library, own.gates.scaled(scale), first_number=number, starts=starts
            )
            segment = here
        maker.proposals[scene.frame] = proposals
        yield from tracker.step(scene)
        maker.proposals.pop(scene.frame - own.gates.hidden_frames - 2, None)
    if tracker is not None:
        yield from tracker.finish()


def _starts(
    store: Store, plan: TrackPlan, source: SceneSource, unit: Unit
) -> dict[int, list[tuple[str, FloatArray]]] | None:
    """Return the true first box of each labelled object, at the first frame that shows it."""
    if plan.start == "labels":
        return None
    from tcrdata.truth_starts import first_boxes

    return first_boxes(store, source, unit.dataset, unit.sequence, plan.settings.least_truth_points)
