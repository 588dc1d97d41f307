"""A build, read as a table of contents: plan, frames, truth, cues, selections.

Each (stage, dataset, sequence, round) is a unit of work. A unit that has its record is done; what a
killed build left half made is not visible, and the next build makes it again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from tcrdata import plan as planning
from tcrdata import registry
from tcrdata.errors import DatasetError, EvidenceError, TcrdataError
from tcrdata.executors import Processes, Serial, executor
from tcrdata.frame_ranges import FrameRanges
from tcrdata.ingest import frame_inputs, frames_of, ingest_frames, ingest_truth
from tcrdata.plan import FAILED, FRAMES, ROUND, TRUTH, Plan
from tcrdata.rules import Selection, preset_names, select
from tcrdata.store import Store, Unit, open_store
from tcrdata.types import CueInput, Dataset, Map, SequenceInfo

State = Literal["done", "made", "failed", "skipped", "todo"]


@dataclass(frozen=True)
class UnitOutcome:
    """What became of one unit of work.

    Attributes:
        unit: the unit.
        state: `done` before, `made` now, `failed`, `skipped` (something it needs failed) or
            `todo` (in a dry run).
        error: why it failed.
        frame_errors: (frame, message) of frames left out.
        seconds: wall time it took; for reports alone, never for the store.
    """

    unit: Unit
    state: State
    error: str | None = None
    frame_errors: tuple[tuple[int, str], ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class BuildReport:
    """What a build did: one outcome a unit, and the selections it ended with."""

    outcomes: tuple[UnitOutcome, ...]
    selections: tuple[Selection, ...] = field(default=())

    def count(self, state: State) -> int:
        """Number of units with a state."""
        return sum(outcome.state == state for outcome in self.outcomes)


Progress = Callable[[UnitOutcome], None]


def plan_build(
    dataset: str,
    root: str,
    *,
    sequences: tuple[str, ...] | None = None,
    frames: FrameRanges | None = None,
    presets: tuple[str, ...] = ("tcrdata",),
    assignments: dict[str, str] | None = None,
) -> Plan:
    """Return the plan of a build; reads only the names of sequences.

    Args:
        dataset: name or dotted path of a dataset adapter.
        root: where it lies.
        sequences: which ones; None for all.
        frames: which frames of each; None for all.
        presets: presets whose evidence is needed; `all` for every one.
        assignments: `cue.field=value` for cues, `parameter=value` for rules.

    Raises:
        SettingsError: an unknown name or value.
        DatasetError: the root is none of this dataset, or lacks a sequence.
    """
    adapter = registry.find("datasets", dataset).open_dataset(root)
    values = assignments or {}
    names = preset_names() if "all" in presets else presets
    parameters = {name: text for name, text in values.items() if "." not in name}
    loaded = planning.loaded_presets(names, parameters)
    cues = planning.ordered_cues({cue for preset in loaded for cue in preset.cues})
    return Plan(
        dataset=dataset,
        root=adapter.root,
        sequences=planning.chosen_sequences(adapter, sequences),
        frames=frames or FrameRanges(),
        presets=tuple(names),
        cues=cues,
        cue_settings=planning.cue_settings(cues, {k: v for k, v in values.items() if "." in k}),
        parameters=parameters,
        loaded=tuple(loaded),
    )


def build(plan: Plan, store_url: str, *, workers: int, progress: Progress) -> BuildReport:
    """Make what is missing of a plan, then select labels with each of its presets.

    Sequences run side by side when there are as many as workers; else the frames of one do.
    Rows do not depend on which.

    Args:
        plan: what to build.
        store_url: where; created when absent.
        workers: worker processes.
        progress: called with each unit's outcome as it is known.

    Raises:
        TcrdataError: the store cannot be written, or a selection lacks evidence.
    """
    store = open_store(store_url, create=True)
    planning.record_run(store, plan)
    outcomes: list[UnitOutcome] = []
    for outcome in _outcomes(store, plan, workers):
        progress(outcome)
        outcomes.append(outcome)
    sound = {outcome.unit.stage for outcome in outcomes if outcome.state in ("done", "made")}
    selections = _selections(store, plan) if sound.intersection(plan.cues) else ()
    store.checkpoint()
    return BuildReport(tuple(outcomes), selections)


def dry_run(plan: Plan, store_url: str) -> BuildReport:
    """Return which units a build would make and which are done; writes nothing."""
    dataset = registry.find("datasets", plan.dataset).open_dataset(plan.root)
    try:
        store: Store | None = open_store(store_url)
    except TcrdataError:
        store = None
    outcomes: list[UnitOutcome] = []
    for sequence in plan.sequences:
        outcomes.extend(_foreseen(store, plan, dataset, sequence))
    return BuildReport(tuple(outcomes))


def _foreseen(
    store: Store | None, plan: Plan, dataset: Dataset, sequence: str
) -> Iterator[UnitOutcome]:
    """Yield each unit as `done` or `todo`: what needs a unit that is to do is to do as well."""
    try:
        info = dataset.info(sequence)
    except DatasetError as error:
        yield UnitOutcome(Unit(FRAMES, plan.dataset_name, sequence, ROUND), "failed", str(error))
        return
    todo: set[str] = set()
    for unit in plan.units(sequence):
        if todo.intersection(_needs(unit.stage)) or not _is_done(store, plan, unit, info):
            todo.add(unit.stage)
        yield UnitOutcome(unit, "todo" if unit.stage in todo else "done")


def _is_done(store: Store | None, plan: Plan, unit: Unit, info: SequenceInfo) -> bool:
    """Whether a build would leave a unit as it is; labels are not read to know it."""
    record = store.record(unit) if store is not None else None
    if store is None or record is None:
        return False
    if unit.stage == TRUTH:
        return FAILED not in record.inputs
    return record.matches(plan.settings_hash(unit.stage), _inputs(store, plan, unit, info))


def build_sequence(store: Store, plan: Plan, sequence: str, parallel: Map) -> Iterator[UnitOutcome]:
    """Make one sequence's units in order, yielding what became of each."""
    dataset: Dataset = registry.find("datasets", plan.dataset).open_dataset(plan.root)
    failed: set[str] = set()
    info: SequenceInfo | None = None
    for unit in plan.units(sequence):
        needs = _needs(unit.stage)
        if broken := failed.intersection(needs):
            failed.add(unit.stage)
            yield UnitOutcome(unit, "skipped", f"{', '.join(sorted(broken))} failed")
            continue
        started = time.perf_counter()
        try:
            if unit.stage == FRAMES:
                info = dataset.info(sequence)
            made = _made(store, plan, dataset, info, unit, parallel)
        except (DatasetError, EvidenceError) as error:
            failed.add(unit.stage)
            _record_failure(store, plan, unit, str(error))
            yield UnitOutcome(unit, "failed", str(error))
            continue
        state: State = "made" if made else "done"
        seconds = time.perf_counter() - started
        yield UnitOutcome(unit, state, None, _frame_errors(store, unit), seconds)


def _outcomes(store: Store, plan: Plan, workers: int) -> Iterator[UnitOutcome]:
    """Run sequences side by side, or one after the other with its frames side by side."""
    with executor(workers) as parallel:
        side_by_side = len(plan.sequences) >= workers and not store.url.startswith("memory")
        if isinstance(parallel, Processes) and side_by_side and len(plan.sequences) > 1:
            tasks = [(store.url, plan, sequence) for sequence in plan.sequences]
            for outcomes in parallel(_whole_sequence, tasks):
                yield from outcomes
        else:
            for sequence in plan.sequences:
                yield from build_sequence(store, plan, sequence, parallel)


def _selections(store: Store, plan: Plan) -> tuple[Selection, ...]:
    return tuple(
        select(
            store,
            preset,
            overrides=planning.own_parameters(preset, plan.parameters),
            leave_out_unfinished=True,
        )
        for preset in plan.loaded
    )


def _whole_sequence(task: tuple[str, Plan, str]) -> list[UnitOutcome]:
    url, plan, sequence = task
    return list(build_sequence(open_store(url), plan, sequence, Serial()))


def _made(
    store: Store,
    plan: Plan,
    dataset: Dataset,
    info: SequenceInfo | None,
    unit: Unit,
    parallel: Map,
) -> bool:
    """Make a unit unless it is done; return whether it was made."""
    if unit.stage == TRUTH:
        return ingest_truth(store, plan, dataset, unit.sequence)
    if info is None:
        raise EvidenceError(f"{unit.dataset}/{unit.sequence}: its frames were not read")
    inputs = _inputs(store, plan, unit, info)
    if store.is_done(unit, plan.settings_hash(unit.stage), inputs):
        return False
    if unit.stage == FRAMES:
        ingest_frames(store, plan, dataset, info, parallel)
    else:
        _measure(store, plan, dataset, info, unit, inputs, parallel)
    return True


def _measure(
    store: Store,
    plan: Plan,
    dataset: Dataset,
    info: SequenceInfo,
    unit: Unit,
    inputs: dict[str, str],
    parallel: Map,
) -> None:
    """Run one cue over one sequence and commit its rows."""
    cue = CueInput(
        info=info,
        frames=tuple(frames_of(store, unit.dataset, unit.sequence)),
        dataset=dataset,
        tables=store.tables(unit.dataset, unit.sequence, unit.round),
        settings=plan.cue_settings[unit.stage],
        parallel=parallel,
        round=unit.round,
    )
    hash_ = plan.settings_hash(unit.stage)
    with store.writer(unit, settings_hash=hash_, inputs=inputs) as writer:
        for rows in registry.find("evidence", unit.stage).run(cue):
            if rows.table == "errors":
                for frame, error in zip(rows.columns["frame"], rows.columns["error"], strict=True):
                    writer.error(int(frame), error)
            else:
                writer.append(rows.table, rows.columns)


def _needs(stage: str) -> tuple[str, ...]:
    if stage in (FRAMES, TRUTH):
        return ()
    return (FRAMES, *registry.find("evidence", stage).NEEDS)


def _inputs(store: Store, plan: Plan, unit: Unit, info: SequenceInfo) -> dict[str, str]:
    if unit.stage == FRAMES:
        return frame_inputs(plan, info)
    return planning.cue_inputs(store, unit)


def _record_failure(store: Store, plan: Plan, unit: Unit, error: str) -> None:
    """Leave a record without rows: `status` names the failure and the next build retries."""
    inputs = {FAILED: error}
    with store.writer(unit, settings_hash=plan.settings_hash(unit.stage), inputs=inputs):
        pass


def _frame_errors(store: Store, unit: Unit) -> tuple[tuple[int, str], ...]:
    record = store.record(unit)
    return record.failed_frames if record is not None else ()
