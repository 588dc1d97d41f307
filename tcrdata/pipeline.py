"""A build, read as a table of contents: plan, frames, truth, cues, selections.

Each (stage, dataset, sequence, round) is a unit of work. A unit that has its record is done; what a
killed build left half made is not visible, and the next build makes it again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from tcrdata import plan as planning
from tcrdata import registry
from tcrdata.errors import DatasetError, EvidenceError
from tcrdata.executors import Processes, Serial, executor
from tcrdata.frame_ranges import FrameRanges
from tcrdata.ingest import frames_of, ingest_frames, ingest_truth, unit_inputs
from tcrdata.outcomes import BuildReport, State, UnitOutcome
from tcrdata.plan import FRAMES, TRUTH, Plan, needed_stages
from tcrdata.rules import Selection, select
from tcrdata.store import Store, Unit, open_store
from tcrdata.store.failures import clear_failure, current_failures, record_failure
from tcrdata.types import CueInput, Dataset, Map, SequenceInfo

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
        presets: presets whose evidence is needed; `all` for every one that needs no model.
        assignments: `cue.field=value` for cues, `parameter=value` for rules.

    Raises:
        SettingsError: an unknown name or value.
        DatasetError: the root is none of this dataset, or lacks a sequence.
    """
    adapter = registry.find("datasets", dataset).open_dataset(root)
    values = assignments or {}
    names = planning.first_round_presets() if "all" in presets else presets
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


def build(
    plan: Plan,
    store_url: str,
    *,
    workers: int,
    progress: Progress,
    snapshot: str | None = None,
    newest: bool = True,
) -> BuildReport:
    """Make what is missing of a plan, then select labels with each of its presets.

    Sequences run side by side when there are as many as workers; else the frames of one do.
    Rows do not depend on which.

    Args:
        plan: what to build.
        store_url: where; created when absent.
        workers: worker processes.
        progress: called with each unit's outcome as it is known.
        snapshot: the selections judge its evidence; what is made now waits for the next one.
        newest: selections that were there already become the newest again.

    Raises:
        TcrdataError: the store cannot be written, or a selection lacks evidence.
    """
    store = open_store(store_url, create=snapshot is None)
    if snapshot is not None:
        store.snapshot(snapshot)
    planning.record_run(store, plan)
    outcomes: list[UnitOutcome] = []
    for outcome in _outcomes(store, plan, workers):
        progress(outcome)
        outcomes.append(outcome)
    sound = {outcome.unit.stage for outcome in outcomes if outcome.state in ("done", "made")}
    selections = _selections(store, plan, snapshot, newest) if sound.intersection(plan.cues) else ()
    store.checkpoint()
    return BuildReport(tuple(outcomes), selections)


def build_sequence(store: Store, plan: Plan, sequence: str, parallel: Map) -> Iterator[UnitOutcome]:
    """Make one sequence's units in order, yielding what became of each."""
    dataset: Dataset = registry.find("datasets", plan.dataset).open_dataset(plan.root)
    failed = _failed_before(store, plan, sequence)
    info: SequenceInfo | None = None
    for unit in plan.units(sequence):
        needs = needed_stages(unit.stage)
        if broken := failed.intersection(needs):
            failed.add(unit.stage)
            yield UnitOutcome(unit, "skipped", f"{', '.join(sorted(broken))} failed")
            continue
        started = time.perf_counter()
        try:
            if info is None and unit.stage != TRUTH:
                info = dataset.info(sequence)
            made = _made(store, plan, dataset, info, unit, parallel)
        except (DatasetError, EvidenceError) as error:
            failed.add(unit.stage)
            record_failure(store, unit, str(error))
            yield UnitOutcome(unit, "failed", str(error))
            continue
        clear_failure(store, unit)
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


def _failed_before(store: Store, plan: Plan, sequence: str) -> set[str]:
    """Stages that the first round could not make of a sequence: later ones do without it."""
    if plan.round == planning.ROUND:
        return set()
    records = store.sequence_records(plan.dataset_name, sequence)
    return {unit.stage for unit in current_failures(records) if unit.round < plan.round}


def _selections(
    store: Store, plan: Plan, snapshot: str | None, newest: bool
) -> tuple[Selection, ...]:
    return tuple(
        select(
            store,
            preset,
            overrides=planning.own_parameters(preset, plan.parameters),
            round=plan.round,
            snapshot=snapshot,
            leave_out_unfinished=True,
            newest=newest,
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
    inputs = unit_inputs(store, plan, unit, info)
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


def _frame_errors(store: Store, unit: Unit) -> tuple[tuple[int, str], ...]:
    record = store.record(unit)
    return record.failed_frames if record is not None else ()
