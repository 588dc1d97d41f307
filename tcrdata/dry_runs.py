"""What a build would make, without making it."""

from __future__ import annotations

from collections.abc import Iterator

from tcrdata import registry
from tcrdata.errors import DatasetError
from tcrdata.ingest import unit_inputs
from tcrdata.outcomes import BuildReport, UnitOutcome
from tcrdata.plan import FRAMES, ROUND, TRUTH, Plan, needed_stages
from tcrdata.store import Store, Unit, open_store, store_exists
from tcrdata.store.failures import current_failures
from tcrdata.types import Dataset, SequenceInfo


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
