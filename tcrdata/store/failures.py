"""Units that could not be made: kept beside the records of what was, which stay as they are."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from tcrdata.store.commits import CommitRecord, Unit

if TYPE_CHECKING:
    from tcrdata.store.store import Store

_PREFIX = "failed-"


def record_failure(store: Store, unit: Unit, error: str) -> None:
    """Keep why a unit could not be made; rows that an earlier build left stay visible.

    A failure holds until the unit gets a newer generation, or another failure takes its place.
    """
    _write(store, unit, error)


def clear_failure(store: Store, unit: Unit) -> None:
    """Take back a failure: what the store has of the unit is right after all."""
    if unit in current_failures(store.sequence_records(unit.dataset, unit.sequence)):
        _write(store, unit, "")


def current_failures(records: Iterable[CommitRecord]) -> dict[Unit, str]:
    """Return the error of each unit that failed and has not been made since.

    Args:
        records: the newest of every unit, or of every unit of some sequences.
    """
    records = list(records)
    generations = {record.unit: record.generation for record in records}
    failures: dict[Unit, str] = {}
    for record in records:
        if is_failure(record):
            stage = record.unit.stage.removeprefix(_PREFIX)
            unit = Unit(stage, record.unit.dataset, record.unit.sequence, record.unit.round)
            unmade_since = record.inputs["after"] == str(generations.get(unit, 0))
            if record.inputs["error"] and unmade_since:
                failures[unit] = record.inputs["error"]
    return failures


def is_failure(record: CommitRecord) -> bool:
    """Whether a record tells of a failure, and not of rows."""
    return record.unit.stage.startswith(_PREFIX)


def _write(store: Store, unit: Unit, error: str) -> None:
    made = store.record(unit)
    inputs = {"error": error, "after": str(made.generation if made else 0)}
    failure = Unit(_PREFIX + unit.stage, unit.dataset, unit.sequence, unit.round)
    if not store.is_done(failure, "", inputs):
        with store.writer(failure, settings_hash="", inputs=inputs):
            pass
