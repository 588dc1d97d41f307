"""Selections: one run of a preset over a frozen list of files."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import duckdb
import pyarrow as pa

from tcrdata.errors import MissingEvidenceError
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.judging import judge
from tcrdata.rules.preset_files import load_preset
from tcrdata.rules.presets import FilledPreset, Preset
from tcrdata.rules.rounds import of_round, rounds_read
from tcrdata.store import FileEntry, Snapshot, Store, Unit
from tcrdata.store.failures import current_failures, is_failure
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.views import create_views
from tcrdata.store.writer import Writer

STAGE = "selection"
ANY_DATASET = "_"
TRUTH_STAGE = "ground_truth"  # no rule reads it: its failure keeps nobody waiting
BATCH_ROWS = 2_000_000
"""Proposals judged at once, whole sequences: bounds the memory, decides nothing."""

_BATCH = "batch"  # schema that holds the views of the batch at hand


@dataclass(frozen=True)
class Selection:
    """A selection that the store holds.

    Attributes:
        selection_id: hash of rule texts, parameters, preset text and evidence.
        name: what the newest pointer calls it.
        preset: the preset's name.
        round: EM round.
        snapshot: the frozen list of files it read.
        proposals_judged: proposals that the first rule saw.
        labels: positive labels that came out.
        ignored: labels left undecided.
        made: False when the same selection was there already.
    """

    selection_id: str
    name: str
    preset: str
    round: int
    snapshot: str
    proposals_judged: int
    labels: int
    ignored: int
    made: bool


def select(
    store: Store,
    preset: str | Preset,
    overrides: Mapping[str, object] | None = None,
    *,
    name: str | None = None,
    round: int = 1,
    snapshot: str | None = None,
    leave_out_unfinished: bool = False,
    newest: bool = True,
) -> Selection:
    """Judge a store's proposals with a preset, write the labels and point to them.

    Args:
        store: evidence is read from it, labels are written to it.
        preset: name, path or a loaded preset.
        overrides: parameter name to value, or its text.
        name: of the selection; the preset's without one.
        round: EM round; its evidence is what was measured in round 1 and what its models say.
        snapshot: read its files instead of those of this moment.
        leave_out_unfinished: judge no proposal of a sequence that lacks a stage: another build
            may be at work on it, and selects when it is through.
        newest: make it the newest selection even if it was there already.

    Raises:
        SettingsError: unknown preset or parameter, or a value of the wrong type.
        RuleError: a rule or preset file is wrong; names file and line.
        MissingEvidenceError: a stage that the preset reads has not been built for a sequence.
    """
    loaded = load_preset(preset) if isinstance(preset, str) else preset
    filled = loaded.fill(overrides)
    lacking, filled = _lacking(store, filled, round)
    unfinished = [(*key, stages) for key, stages in lacking.items() if stages]
    if unfinished and not leave_out_unfinished:
        raise _missing(store, filled, *unfinished[0])
    frozen = store.snapshot(snapshot) if snapshot else store.freeze(None, EVIDENCE_TABLES)
    files = [
        entry
        for entry in frozen.files
        if entry.table in EVIDENCE_TABLES
        and entry.unit.round in rounds_read(round)
        and not lacking.get((entry.unit.dataset, entry.unit.sequence), filled.cues)
    ]
    identity = _identity(filled, files, round)
    unit = Unit(STAGE, ANY_DATASET, identity[:16], round)
    name = name or filled.name
    inputs = {"evidence": _digest_of(files)}
    made = not store.is_done(unit, identity, inputs)
    if made:
        with store.writer(unit, settings_hash=identity, inputs=inputs) as writer:
            _append_beside(writer, _rows(store, filled, frozen, files, unit, name))
    if made or newest or store.newest_selection(unit.sequence) is None:
        store.point_to(unit.sequence, name)
    (row,) = store.read("selections", dataset=ANY_DATASET, sequence=unit.sequence).to_pylist()
    return Selection(
        unit.sequence, name, row["preset"], round, row["snapshot"], row["proposals_judged"],
        row["labels"], row["ignored"], made,
    )  # fmt: skip


def _append_beside(writer: Writer, rows: Iterator[tuple[str, dict[str, Any]]]) -> None:
    """Append rows in order, each batch while the next one is judged."""
    with ThreadPoolExecutor(max_workers=1) as beside:
        before: Future[None] | None = None
        for table, columns in rows:
            if before is not None:
                before.result()
            before = beside.submit(writer.append, table, columns)
        if before is not None:
            before.result()


def _lacking(
    store: Store, preset: FilledPreset, round: int
) -> tuple[dict[tuple[str, str], list[str]], FilledPreset]:
    """Each dataset and sequence with the stages that the preset reads and it lacks.

    A sequence of which a stage failed lacks none: more does not come of it. The preset comes back
    with those alternatives alone whose stages every sequence has.
    """
    records = store.records()
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


def _missing(
    store: Store, preset: FilledPreset, dataset: str, sequence: str, stages: list[str]
) -> MissingEvidenceError:
    """Say which build makes what a sequence lacks."""
    return MissingEvidenceError(
        f"preset {preset.name} reads {', '.join(stages)}, which {dataset}/{sequence} lacks; "
        f"run `tcrdata build --dataset {dataset} --root {_root(store, dataset, sequence)} "
        f"--store {store.url} --sequences {sequence} --preset {preset.name}`"
    )


def _root(store: Store, dataset: str, sequence: str) -> str:
    """Where the sequence's files lie."""
    rows = store.read("sequences", columns=["root"], dataset=dataset, sequence=sequence)
    return str(rows["root"][0].as_py()) if rows.num_rows else "ROOT"


def _identity(preset: FilledPreset, files: Sequence[FileEntry], round: int) -> str:
    """Hash of all that the labels follow from."""
    content = {
        **_written(preset),
        "alternatives": [_written(other) for other in preset.alternatives],
        "round": round,
        "evidence": _digest_of(files),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _written(preset: FilledPreset) -> dict[str, Any]:
    """What a preset decides by."""
    return {
        "name": preset.name,
        "rules": [[rule.name, rule.select, rule.required] for rule in preset.rules],
        "preset": preset.select,
        "parameters": preset.parameters,
    }


def _digest_of(files: Sequence[FileEntry]) -> str:
    """Hash of the content of files and of what they are files of."""
    lines = sorted(f"{f.table} {f.unit} {f.sha256}" for f in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _rows(
    store: Store,
    preset: FilledPreset,
    frozen: Snapshot,
    files: Sequence[FileEntry],
    unit: Unit,
    name: str,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Labels batch by batch, then the selection's own row."""
    import pyarrow.compute as pc

    judged = positive = undecided = 0
    opened = Filesystem(store.url)
    with duckdb.connect() as connection:
        connection.execute("set global parquet_metadata_cache = true")
        for batch in _batches(files):
            connection.execute(f"drop schema if exists {_BATCH} cascade")
            create_views(connection, opened, batch, {}, _BATCH)
            relations = {t: of_round(f"{_BATCH}.{t}", unit.round) for t in EVIDENCE_TABLES}
            rows = sum(entry.rows for entry in batch["proposals"])
            labels = judge(connection, preset, relations, rows)
            judged += rows
            positive += pc.sum(pc.equal(labels["state"], "positive")).as_py() or 0
            undecided += pc.sum(pc.equal(labels["state"], "ignore")).as_py() or 0
            columns = {name: labels[name] for name in labels.column_names}
            yield "labels", {"selection_id": pa.repeat(unit.sequence, len(labels)), **columns}
    yield "labels", {}
    yield (
        "selections",
        {
            "selection_id": [unit.sequence],
            "name": [name],
            "preset": [preset.name],
            "round": [unit.round],
            "snapshot": [frozen.name],
            "rules": [[rule.name for rule in preset.rules]],
            "rule_texts": [[rule.select for rule in preset.rules]],
            "required": [[rule.required for rule in preset.rules]],
            "preset_text": [preset.select],
            "parameters": [list(preset.parameters.items())],
            "proposals_judged": [judged],
            "alternatives": [json.dumps([_written(p) for p in preset.alternatives])],
            "labels": [positive],
            "ignored": [undecided],
        },
    )


def _batches(files: Sequence[FileEntry]) -> Iterator[dict[str, list[FileEntry]]]:
    """Files of whole sequences, in order, about BATCH_ROWS proposals together."""
    sequences: dict[tuple[str, str], list[FileEntry]] = defaultdict(list)
    for entry in files:
        sequences[entry.unit.dataset, entry.unit.sequence].append(entry)
    batch: dict[str, list[FileEntry]] = {table: [] for table in EVIDENCE_TABLES}
    rows = 0
    for key in sorted(sequences):
        more = sum(entry.rows for entry in sequences[key] if entry.table == "proposals")
        if rows and rows + more > BATCH_ROWS:
            yield batch
            batch, rows = {table: [] for table in EVIDENCE_TABLES}, 0
        for entry in sequences[key]:
            batch[entry.table].append(entry)
        rows += more
    if rows:
        yield batch
