"""What a store holds: units done, failed and missing, frames left out, rows and bytes a table."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from typing import Any

from tcrdata.plan import ROUND
from tcrdata.store import Store, Unit
from tcrdata.store.failures import current_failures, is_failure

MODEL = "model"
"""Stage of a training."""


@dataclass(frozen=True)
class StoreStatus:
    """What a store holds.

    Attributes:
        done: units with rows, or with none to have.
        failed: units that could not be made when last tried.
        missing: units that a build was asked for and that have no record.
        tables: (table, rows, bytes, files), sorted.
        problems: (where, frame or None, message).
        selections: (id, name, labels, round), oldest first.
        rounds: (round, models trained for it, units done, failed, missing), by round.
    """

    done: int
    failed: int
    missing: int
    tables: list[tuple[str, int, int, int]]
    problems: list[tuple[str, int | None, str]]
    selections: list[tuple[str, str, int, int]]
    rounds: list[tuple[int, int, int, int, int]]

    def as_dict(self) -> dict[str, Any]:
        """The status as plain values for JSON."""
        return {
            "units": {"done": self.done, "failed": self.failed, "missing": self.missing},
            "tables": [
                dict(zip(("table", "rows", "bytes", "files"), row, strict=True))
                for row in self.tables
            ],
            "problems": [
                dict(zip(("where", "frame", "error"), row, strict=True)) for row in self.problems
            ],
            "selections": [
                dict(zip(("selection_id", "name", "labels", "round"), row, strict=True))
                for row in self.selections
            ],
            "rounds": [
                dict(zip(("round", "models", "done", "failed", "missing"), row, strict=True))
                for row in self.rounds
            ],
        }


def store_status(store: Store) -> StoreStatus:
    """Return what a store holds, from its commit records alone: no row is read but of `runs`."""
    records = store.records()
    failures = current_failures(records)
    problems: list[tuple[str, int | None, str]] = [
        (_where(unit), None, error) for unit, error in failures.items()
    ]
    totals: dict[str, list[int]] = {}
    for record in records:
        problems.extend((_where(record.unit), *problem) for problem in record.failed_frames)
        for file in record.files:
            total = totals.setdefault(file.table, [0, 0, 0])
            total[0] += file.rows
            total[1] += file.bytes
            total[2] += 1
    made = {record.unit for record in records if not is_failure(record)}
    selections = [
        (row["selection_id"], row["name"], row["labels"], row["round"])
        for row in store.read("selections").to_pylist()
    ]
    done, failed = made - set(failures), set(failures)
    missing = planned_units(store) - made - failed
    return StoreStatus(
        done=len(done),
        failed=len(failed),
        missing=len(missing),
        tables=[(name, *totals[name]) for name in sorted(totals)],  # type: ignore[misc]
        problems=problems,
        selections=selections,
        rounds=_rounds(done, failed, missing),
    )


def _rounds(
    done: set[Unit], failed: set[Unit], missing: set[Unit]
) -> list[tuple[int, int, int, int, int]]:
    """Count units by round; a model belongs to the round that measures with it."""
    models = Counter(unit.round + 1 for unit in done if unit.stage == MODEL)
    counts = [Counter(unit.round for unit in units) for units in (done, failed, missing)]
    numbers = sorted(set(models).union(*counts))
    return [(number, models[number], *(c[number] for c in counts)) for number in numbers]  # type: ignore[misc]


def _where(unit: Unit) -> str:
    return f"{unit.dataset}/{unit.sequence} {unit.stage}"


def planned_units(store: Store) -> set[Unit]:
    """Return every unit that a build of this store was asked for."""
    units: set[Unit] = set()
    for row in store.read("runs").to_pylist():
        plan = json.loads(row["settings"])
        units |= {
            Unit(stage, plan["dataset"], sequence, plan.get("round", ROUND))
            for sequence in plan["sequences"]
            for stage in plan["stages"]
        }
    return units
