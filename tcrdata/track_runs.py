"""Tracking of a store's sequences: units of work that read labels and leave tracklets.

Short range alone comes first, in every sequence: what it finds is what the library is chosen from.
With the library, every sequence is then tracked once more, and the long range links what came back.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tcrdata import __version__, registry, settings
from tcrdata.errors import DatasetError, EvidenceError, MissingEvidenceError
from tcrdata.evidence.models import Model, ModelChoice, read_model
from tcrdata.executors import TRACKING, Processes, Serial
from tcrdata.outcomes import UnitOutcome
from tcrdata.plan import FRAMES, TRUTH
from tcrdata.reports import run_report
from tcrdata.store import Store, Unit, open_store
from tcrdata.store.followed import stage_of
from tcrdata.track_plans import TrackPlan, boxes_of, passes, unit_of
from tcrdata.tracked_rows import RowMaker, columns_of
from tcrdata.tracked_scenes import SceneSource, scene_source
from tcrdata.tracking.known_fits import KnownFits
from tcrdata.tracking.library import library_of_rows
from tcrdata.tracking.short_range import short_range
from tcrdata.tracking.tracker import Finished, Tracker
from tcrdata.tracklet_boxes import write_boxes
from tcrdata.truth_starts import first_boxes
from tcrdata.types import BOX_COLUMNS, FloatArray

_LABEL_COLUMNS = ("proposal_id", "frame", "state", "score", "source", "track_id", *BOX_COLUMNS)
_ROWS_AT_ONCE = 4096
_READ = (FRAMES, "ground", "odometry", "flow_ransac", "flow", "objectness2d", "objectness3d")
"""Stages whose rows trackers read: poses, ground, flow, and what networks say of proposals."""


def track(
    store_url: str, plan: TrackPlan, *, workers: int, progress: Callable[[UnitOutcome], None]
) -> list[UnitOutcome]:
    """Make what is missing of a tracking.

    Raises:
        TcrdataError: the store cannot be read or written.
    """
    outcomes = []
    beside = len(plan.sequences) < 2 and workers > 1
    if plan.library:
        # The rule for the library runs between the passes: loaded while workers get ready.
        import duckdb  # noqa: F401
    with (
        TemporaryDirectory(prefix="tcrdata-track-") as spool,
        _workers(store_url, plan, workers) as parallel,
    ):
        for library, start in passes(plan):
            store = open_store(store_url)
            entries = _library_rows(store, plan) if library else []
            part = replace(plan, library=library, start=start)
            for outcome in _outcomes(store_url, part, entries, parallel, spool, beside=beside):
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
        unit = boxes_of(plan, *key)
        made = write_boxes(store, unit, unit_of(plan, *key), library=plan.library)
        yield UnitOutcome(unit, "made" if made else "done")


def _workers(store_url: str, plan: TrackPlan, workers: int) -> Serial | Processes:
    """Return what tracks sequences side by side; rows do not depend on how many at once.

    One alone has a worker, too: its libraries are loaded while this process makes its plan.
    """
    if workers < 2 or store_url.startswith("memory"):
        return Serial()
    return Processes(min(workers, len(plan.sequences)), TRACKING)


def _outcomes(
    store_url: str,
    plan: TrackPlan,
    entries: list[dict[str, Any]],
    parallel: Serial | Processes,
    spool: str,
    *,
    beside: bool,
) -> Iterator[UnitOutcome]:
    """Track sequences; where there is one alone, its frames are read in a thread beside.

    The folder `spool` takes what one pass over a sequence finds that the next one asks again.
    """
    known = settings.digest(entries)
    tasks = [
        (store_url, plan, entries, known, beside, str(Path(spool, str(number))), *key)
        for number, key in enumerate(plan.sequences)
    ]
    return parallel(_track_sequence, tasks)


def _track_sequence(
    task: tuple[str, TrackPlan, list[dict[str, Any]], str, bool, str, str, str],
) -> UnitOutcome:
    """Track one sequence; where it has the cores alone, frames are read beside."""
    url, plan, entries, known, beside, spooled, dataset, sequence = task
    store = open_store(url)
    unit = unit_of(plan, dataset, sequence)
    labels = _labels(store, plan.selection_id, dataset, sequence)
    inputs = _inputs(store, plan, unit, labels, known)
    plain = {"version": __version__, "settings": settings.as_plain(plan.settings)}
    hash_ = settings.digest(plain)
    if store.is_done(unit, hash_, inputs):
        return UnitOutcome(unit, "done")
    try:
        source = scene_source(
            store, _dataset(store, dataset, sequence), dataset, sequence, labels, plan.round,
            _model(store, plan), beside=beside,
        )  # fmt: skip
        with (
            _known_fits(plan, Path(spooled)) as fits,
            store.writer(unit, settings_hash=hash_, inputs=inputs) as writer,
        ):
            for table, columns in _rows(store, plan, source, unit, entries, fits, writer.error):
                writer.append(table, columns)
    except (DatasetError, EvidenceError, MissingEvidenceError) as error:
        return UnitOutcome(unit, "failed", str(error))
    record = store.record(unit)
    return UnitOutcome(unit, "made", frame_errors=record.failed_frames if record else ())


def _known_fits(plan: TrackPlan, path: Path) -> AbstractContextManager[KnownFits | None]:
    """Return the fits that the pass before this one left, or what this one leaves for the next."""
    if plan.start == "truth" or (plan.library and not path.exists()):
        return nullcontext()
    return KnownFits(path)


def _model(store: Store, plan: TrackPlan) -> Model | None:
    """Return the detector whose features are correlated; None without one."""
    if not plan.model:
        return None
    return read_model(store, ModelChoice("detector", plan.model, "", plan.round))


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
    store: Store, plan: TrackPlan, unit: Unit, labels: list[dict[str, Any]], entries: str
) -> dict[str, str]:
    """Return digests of what a unit's rows follow from: content, not names of selections."""
    inputs = {"labels": settings.digest(labels), "detector": plan.model}
    for record in store.sequence_records(unit.dataset, unit.sequence):
        own = record.unit
        read = own.stage in _READ or (own.stage == TRUTH and plan.start == "truth")
        if read and own.round <= plan.round:
            inputs[f"{own.stage}.r{own.round}"] = record.digest
    if plan.library:
        inputs["library"] = entries
    return inputs


def _library_rows(store: Store, plan: TrackPlan) -> list[dict[str, Any]]:
    """Return what the rule lets into the library, of the selection's tracklets."""
    connection = store.connect(tables=("trajectories",))
    try:
        parameters = {**plan.entries, "entries_selection": plan.selection_id}
        found = run_report(connection, "library_entries", parameters, folder="tracking")
        rows: list[dict[str, Any]] = found.to_arrow_table().to_pylist()
    finally:
        connection.close()
    return rows


def _rows(
    store: Store,
    plan: TrackPlan,
    source: SceneSource,
    unit: Unit,
    entries: list[dict[str, Any]],
    fits: KnownFits | None,
    failed: Callable[[int, str], None],
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Track one sequence; yields batches of rows, and tells `failed` of frames left out."""
    table = "tracklets" if plan.start == "labels" else "truth_tracklets"
    with_paths = plan.start == "labels" and not plan.library
    maker = RowMaker(
        source.world,
        source.tables,
        f"{unit.dataset}/{unit.sequence}/{stage_of(table.removesuffix('s'), plan.selection_id)}",
        source.metric_scale,
        {
            "selection_id": plan.selection_id,
            "library": plan.library,
            "tracker": plan.settings.tracker,
        },
        source.labels,
        settings=plan.settings.library if with_paths else None,
    )
    waiting: dict[str, list[dict[str, Any]]] = defaultdict(list)
    columns = {table: maker.tracklet_columns, "trajectories": columns_of}
    yield table, {}
    if with_paths:
        yield "trajectories", {}
    starts = _starts(store, plan, source, unit)
    for finished in _followed(plan, source, entries, starts, fits, failed):
        waiting[table] += maker.tracklet_rows(finished)
        waiting["trajectories"] += maker.trajectory_rows(finished.number, over=finished.over)
        for name, rows in waiting.items():
            if len(rows) > _ROWS_AT_ONCE:
                yield name, columns[name](rows)
                rows.clear()
    for name, rows in waiting.items():
        if rows:
            yield name, columns[name](rows)


def _followed(
    plan: TrackPlan,
    source: SceneSource,
    entries: list[dict[str, Any]],
    starts: dict[int, list[tuple[str, FloatArray]]] | None,
    fits: KnownFits | None,
    failed: Callable[[int, str], None],
) -> Iterator[Finished]:
    """Yield what trackers hand on; where egomotion has a break, a new one begins."""
    own, scale = plan.settings, source.metric_scale
    scaled = replace(own.short, correlation=own.short.correlation.scaled(scale))
    short = short_range(own.tracker, scaled, fits)
    library = library_of_rows(entries, scale) if plan.library else None
    tracker: Tracker | None = None
    segment, number = -1, 0
    for scene in source.scenes(failed):
        here = source.world.poses.segment[scene.frame]
        if tracker is None or here != segment:
            if tracker is not None:
                yield from tracker.finish()
                number = tracker.next_number
            tracker = Tracker(
                short, library, own.gates.scaled(scale), first_number=number, starts=starts
            )
            segment = here
        yield from tracker.step(scene)
    if tracker is not None:
        yield from tracker.finish()


def _starts(
    store: Store, plan: TrackPlan, source: SceneSource, unit: Unit
) -> dict[int, list[tuple[str, FloatArray]]] | None:
    """Return the true first box of each labelled object, at the first frame that shows it."""
    if plan.start == "labels":
        return None
    return first_boxes(store, source, unit.dataset, unit.sequence, plan.settings.least_truth_points)
