"""Selections: one run of a preset over a frozen list of files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.preset_files import load_preset
from tcrdata.rules.presets import FilledPreset, Preset
from tcrdata.rules.rounds import rounds_read
from tcrdata.rules.selection_rows import Run, decided_by, selection_rows
from tcrdata.rules.unfinished import lacking_stages, missing_evidence
from tcrdata.store import FileEntry, Store, Unit
from tcrdata.store.commits import ANY_DATASET
from tcrdata.store.followed import is_read, newest_tracked

if TYPE_CHECKING:
    from tcrdata.store.snapshots import Snapshot
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
        followed: id of the selection whose tracked boxes it was offered; None without any.
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
    followed: str | None = None


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
    followed: str | None = None,
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
        followed: id of the selection whose tracked boxes a preset with `-- follows:` takes; the
            newest tracked one of the round and the preset named there when None.

    Raises:
        SettingsError: unknown preset or parameter, or a value of the wrong type.
        RuleError: a rule or preset file is wrong; names file and line.
        MissingEvidenceError: a stage that the preset reads has not been built for a sequence.
    """
    loaded = load_preset(preset) if isinstance(preset, str) else preset
    filled = loaded.fill(overrides)
    records = store.records()
    lacking, filled = lacking_stages(store, records, filled, round)
    unfinished = [(*key, stages) for key, stages in lacking.items() if stages]
    if unfinished and not leave_out_unfinished:
        raise missing_evidence(store, records, filled, *unfinished[0])
    if filled.follows and followed is None:
        followed = newest_tracked(store, filled.follows, round)
    whom = followed if filled.follows else None
    called = name or filled.name
    frozen = store.snapshot(snapshot) if snapshot else None
    files = frozen.files if frozen else store.files_of(EVIDENCE_TABLES, records)
    seen = [entry for entry in files if is_read(entry.unit.stage, whom)]
    own = _judged(seen, lacking, filled, round)
    made = not store.is_done(own.unit, own.identity, own.inputs)
    if made:
        # Only now: a store that is done stays as it is, whatever was measured since.
        _make(
            store, own, filled, called, lambda: frozen or store.freeze(None, EVIDENCE_TABLES, seen)
        )
    chosen = own.unit.sequence
    if made or newest or store.newest_selection(chosen) is None:
        store.point_to(chosen, called)
    (row,) = store.read("selections", dataset=ANY_DATASET, sequence=chosen).to_pylist()
    return Selection(
        chosen, called, row["preset"], round, row["snapshot"], row["proposals_judged"],
        row["labels"], row["ignored"], made, whom,
    )  # fmt: skip


@dataclass(frozen=True)
class _Judgement:
    """What a selection judges, and what it is called for that.

    Attributes:
        files: those that the rules see.
        evidence: hash of them.
        identity: hash of all that the labels follow from.
        round: EM round.
    """

    files: list[FileEntry]
    evidence: str
    identity: str
    round: int

    @property
    def unit(self) -> Unit:
        """The unit of the selection's rows; its sequence is the selection's id."""
        return Unit(STAGE, ANY_DATASET, self.identity[:16], self.round)

    @property
    def inputs(self) -> dict[str, str]:
        """What the unit follows from, for its record."""
        return {"evidence": self.evidence}


def _judged(
    files: Sequence[FileEntry],
    lacking: Mapping[tuple[str, str], list[str]],
    preset: FilledPreset,
    round: int,
) -> _Judgement:
    """Take those files that the rules of a round see, of sequences that lack no stage."""
    own = [
        entry
        for entry in files
        if entry.table in EVIDENCE_TABLES
        and entry.unit.round in rounds_read(round)
        and not lacking.get((entry.unit.dataset, entry.unit.sequence), preset.cues)
    ]
    evidence = _digest_of(own)
    return _Judgement(own, evidence, _identity(preset, evidence, round), round)


def _make(
    store: Store, own: _Judgement, preset: FilledPreset, name: str, freeze: Callable[[], Snapshot]
) -> None:
    """Write a selection's rows; its files are frozen, and rows appended, beside the judging."""
    writing = store.writer(own.unit, settings_hash=own.identity, inputs=own.inputs)
    with writing as writer, ThreadPoolExecutor(max_workers=1) as beside:
        freezing = beside.submit(freeze)
        run = Run(preset, lambda: freezing.result().name, own.files, own.unit, name)
        _append_beside(beside, writer, selection_rows(store, run))


def _append_beside(
    beside: Executor, writer: Writer, rows: Iterator[tuple[str, Mapping[str, Any]]]
) -> None:
    """Append rows in order, each batch while the next one is judged."""
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
