"""What a preset reads and a store lacks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from tcrdata.errors import MissingEvidenceError
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.rounds import rounds_read
from tcrdata.store import Store
from tcrdata.store.commits import ANY_DATASET, CommitRecord
from tcrdata.store.failures import current_failures, is_failure

TRUTH_STAGE = "ground_truth"  # no rule reads it: its failure keeps nobody waiting


def lacking_stages(
    store: Store, records: Sequence[CommitRecord], preset: FilledPreset, round: int
) -> tuple[dict[tuple[str, str], list[str]], FilledPreset]:
    """Return each dataset and sequence with the stages that the preset reads and it lacks.

    A sequence of which a stage failed lacks none: more does not come of it. The preset comes back
    with those alternatives alone whose stages every sequence has. `records` are the store's.
    """
    stages: dict[tuple[str, str], set[str]] = defaultdict(set)
    for record in records:
        unit = record.unit
        measured = unit.dataset != ANY_DATASET and unit.round in rounds_read(round)
        if measured and not is_failure(record):
            stages[unit.dataset, unit.sequence].add(unit.stage)
    if not stages:
        raise MissingEvidenceError(
            f"{store.url} holds no evidence of round {round}; run `tcrdata build --dataset D "
            f"--root ROOT --store {store.url} --preset {preset.name}`"
        )
    failed = {(u.dataset, u.sequence) for u in current_failures(records) if u.stage != TRUTH_STAGE}
    whole = [there for key, there in stages.items() if key not in failed]
    alternatives = tuple(
        other for other in preset.alternatives if all(set(other.cues) <= there for there in whole)
    )
    lacking = {
        key: [] if key in failed else [cue for cue in preset.cues if cue not in there]
        for key, there in sorted(stages.items())
    }
    return lacking, replace(preset, alternatives=alternatives)


def missing_evidence(
    store: Store,
    records: Sequence[CommitRecord],
    preset: FilledPreset,
    dataset: str,
    sequence: str,
    stages: list[str],
) -> MissingEvidenceError:
    """The error that says which build makes what a sequence lacks, or which round has it."""
    lacks = f"preset {preset.name} reads {', '.join(stages)}, which {dataset}/{sequence} lacks"
    later = _latest_round(records, dataset, sequence, set(stages))
    if later is not None:
        return MissingEvidenceError(
            f"{lacks} in this round; round {later} has it: give --round {later}"
        )
    return MissingEvidenceError(
        f"{lacks}; run `tcrdata build --dataset {dataset} --root {_root(store, dataset, sequence)} "
        f"--store {store.url} --sequences {sequence} --preset {preset.name}`"
    )


def _latest_round(
    records: Sequence[CommitRecord], dataset: str, sequence: str, stages: set[str]
) -> int | None:
    """The latest round in which a sequence has some stages; None where none has them all."""
    found: dict[int, set[str]] = defaultdict(set)
    for record in records:
        unit = record.unit
        if (unit.dataset, unit.sequence) == (dataset, sequence) and not is_failure(record):
            found[unit.round].add(unit.stage)
    return max((number for number, there in found.items() if stages <= there), default=None)


def _root(store: Store, dataset: str, sequence: str) -> str:
    """Where the sequence's files lie."""
    rows = store.read("sequences", columns=["root"], dataset=dataset, sequence=sequence)
    return str(rows["root"][0].as_py()) if rows.num_rows else "ROOT"
