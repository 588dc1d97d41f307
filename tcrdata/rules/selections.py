"""Selections: one run of a preset over a frozen list of files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.preset_files import load_preset
from tcrdata.rules.presets import FilledPreset, Preset
from tcrdata.rules.rounds import rounds_read
from tcrdata.rules.selection_rows import Run, decided_by, selection_rows
from tcrdata.rules.unfinished import lacking_stages, missing_evidence
from tcrdata.store import FileEntry, Snapshot, Store, Unit
from tcrdata.store.commits import ANY_DATASET

if TYPE_CHECKING:
    from tcrdata.store.writer import Writer

STAGE = "selection"


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
    # Arrow is imported while DuckDB binds the rules.
    Thread(target=import_module, args=("tcrdata.store.writer",)).start()
    loaded = load_preset(preset) if isinstance(preset, str) else preset
    filled = loaded.fill(overrides)
    lacking, filled = lacking_stages(store, filled, round)
    unfinished = [(*key, stages) for key, stages in lacking.items() if stages]
    if unfinished and not leave_out_unfinished:
        raise missing_evidence(store, filled, *unfinished[0])
    frozen = store.snapshot(snapshot) if snapshot else store.freeze(None, EVIDENCE_TABLES)
    files = _files_read(frozen, lacking, filled, round)
    evidence = _digest_of(files)
    identity = _identity(filled, evidence, round)
    unit = Unit(STAGE, ANY_DATASET, identity[:16], round)
    run = Run(filled, frozen.name, files, unit, name or filled.name)
    made = _make(store, run, identity, evidence)
    if made or newest or store.newest_selection(unit.sequence) is None:
        store.point_to(unit.sequence, run.name)
    (row,) = store.read("selections", dataset=ANY_DATASET, sequence=unit.sequence).to_pylist()
    return Selection(
        unit.sequence, run.name, row["preset"], round, row["snapshot"], row["proposals_judged"],
        row["labels"], row["ignored"], made,
    )  # fmt: skip


def _files_read(
    frozen: Snapshot,
    lacking: Mapping[tuple[str, str], list[str]],
    preset: FilledPreset,
    round: int,
) -> list[FileEntry]:
    """The files that the rules of a round see, of sequences that lack no stage."""
    return [
        entry
        for entry in frozen.files
        if entry.table in EVIDENCE_TABLES
        and entry.unit.round in rounds_read(round)
        and not lacking.get((entry.unit.dataset, entry.unit.sequence), preset.cues)
    ]


def _make(store: Store, run: Run, identity: str, evidence: str) -> bool:
    """Write a selection's rows; False when they are there already."""
    inputs = {"evidence": evidence}
    if store.is_done(run.unit, identity, inputs):
        return False
    with store.writer(run.unit, settings_hash=identity, inputs=inputs) as writer:
        _append_beside(writer, selection_rows(store, run))
    return True


def _append_beside(writer: Writer, rows: Iterator[tuple[str, Mapping[str, Any]]]) -> None:
    """Append rows in order, each batch while the next one is judged."""
    with ThreadPoolExecutor(max_workers=1) as beside:
        before: Future[None] | None = None
        for table, columns in rows:
            if before is not None:
                before.result()
            before = beside.submit(writer.append, table, columns)
        if before is not None:
            before.result()


def _identity(preset: FilledPreset, evidence: str, round: int) -> str:
    """Hash of all that the labels follow from."""
    content = {
        **decided_by(preset),
        "alternatives": [decided_by(other) for other in preset.alternatives],
        "round": round,
        "evidence": evidence,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _digest_of(files: Sequence[FileEntry]) -> str:
    """Hash of the content of files and of what they are files of."""
    lines = sorted(f"{f.table} {f.unit} {f.sha256}" for f in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
