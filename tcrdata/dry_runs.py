"""What a build would make, without making it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tcrdata import registry
from tcrdata.errors import DatasetError
from tcrdata.ingest import unit_inputs
from tcrdata.outcomes import BuildReport, UnitOutcome
from tcrdata.plan import FRAMES, ROUND, TRACKING, TRUTH, Plan, needed_stages
from tcrdata.rounds import Loop
from tcrdata.store import Store, Unit, open_store, store_exists
from tcrdata.store.failures import current_failures
from tcrdata.trainings import known_model, learnable, recipe_of
from tcrdata.types import Dataset, SequenceInfo

STAGE, ANY_DATASET = "model", "_"  # of a training


def dry_rounds(loop: Loop, store_url: str) -> BuildReport:
    """Return which units and trainings a build would make and which are done; writes nothing.

    What follows from something that is to do is to do as well.
    """
    report = dry_run(loop.first, store_url)
    report = BuildReport((*report.outcomes, *_tracked(loop, store_url, ROUND, report)))
    for number in range(ROUND + 1, loop.rounds + 1):
        models: dict[str, str] = {}
        kinds = list(loop.kinds)
        if not report.count("todo") and not report.count("failed"):
            kinds = learnable(open_store(store_url), loop.kinds)
            models = _models(loop, open_store(store_url), number - 1)
        outcomes = [
            UnitOutcome(
                Unit(STAGE, ANY_DATASET, models.get(kind, kind), number - 1),
                "done" if kind in models else "todo",
            )
            for kind in kinds
        ]
        plan = loop.plan(number, models)
        if len(models) == len(kinds):
            outcomes.extend(dry_run(plan, store_url).outcomes)
        else:
            units = (unit for sequence in plan.sequences for unit in plan.units(sequence))
            outcomes.extend(UnitOutcome(unit, "todo") for unit in units)
        report = BuildReport((*report.outcomes, *outcomes))
        report = BuildReport((*report.outcomes, *_tracked(loop, store_url, number, report)))
    return report


def _tracked(loop: Loop, store_url: str, number: int, before: BuildReport) -> Iterator[UnitOutcome]:
    """Yield the units of a round's tracking: what is there is done, if all before is."""
    if not loop.followers:
        return
    from tcrdata.track_plans import plan_tracking, units_of

    plan = loop.plan(number, {})
    if before.count("todo"):
        for sequence in plan.sequences:
            for kind in TRACKING:
                yield UnitOutcome(Unit(kind, plan.dataset_name, sequence, number), "todo")
        return
    store = open_store(store_url)
    chosen = _newest(store, plan.loaded[0].name, number)
    if chosen is None or not chosen["labels"]:
        return
    for unit in units_of(plan_tracking(store, chosen["selection_id"])):
        yield UnitOutcome(unit, "todo" if store.record(unit) is None else "done")


def _models(loop: Loop, store: Store, number: int) -> dict[str, str]:
    """Kind to the id of the finished model of a round's newest labels, where there is one."""
    leader = loop.follower(number) or loop.plan(number, {}).loaded[0]
    chosen = _newest(store, leader.name, number)
    if chosen is None:
        return {}
    found = {
        kind: known_model(store, recipe_of(kind, loop.training), chosen["selection_id"])
        for kind in loop.kinds
    }
    return {kind: row["model_id"] for kind, row in found.items() if row and row["finished"]}


def _newest(store: Store, preset: str, number: int) -> dict[str, Any] | None:
    """Return the row of a round's newest selection of a preset; None without one."""
    newest = store.newest_selection(preset)
    rows = store.read("selections", selection_id=newest, round=number).to_pylist()
    if not rows:
        rows = store.read("selections", preset=preset, round=number).to_pylist()
    return rows[-1] if rows else None


def dry_run(plan: Plan, store_url: str) -> BuildReport:
    """Return which units a build would make and which are done; writes nothing."""
    dataset = registry.find("datasets", plan.dataset).open_dataset(plan.root)
    store = open_store(store_url) if store_exists(store_url) else None
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
        if todo.intersection(needed_stages(unit.stage)) or not _is_done(store, plan, unit, info):
            todo.add(unit.stage)
        yield UnitOutcome(unit, "todo" if unit.stage in todo else "done")


def _is_done(store: Store | None, plan: Plan, unit: Unit, info: SequenceInfo) -> bool:
    """Whether a build would leave a unit as it is; labels are not read to know it."""
    record = store.record(unit) if store is not None else None
    if store is None or record is None:
        return False
    if unit in current_failures(store.sequence_records(unit.dataset, unit.sequence)):
        return False
    inputs = unit_inputs(store, plan, unit, info)
    return unit.stage == TRUTH or record.matches(plan.settings_hash(unit.stage), inputs)
