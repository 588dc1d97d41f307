"""The rows that a selection writes: its labels batch by batch, then its own."""

from __future__ import annotations

import json
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import duckdb

from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.rules.judging import judge
from tcrdata.rules.label_parts import LabelPart
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.rounds import of_round
from tcrdata.store import FileEntry, Store, Unit
from tcrdata.store.bundles import read_bundles
from tcrdata.store.filesystem import Filesystem
from tcrdata.store.views import create_views

BATCH_ROWS = 1_000_000
"""Proposals judged in one go, whole sequences: bounds the memory, decides nothing.

Half as many where alternatives are judged as well, whose survivors are held, too.
"""

AT_ONCE = 2
"""Batches judged side by side: planning and putting in order keep one processor busy."""

BUNDLED_ROWS = 2_250_000
"""The same where files are bundled, one batch at a time: a bundle is read where all of it is."""

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Run:
    """One run of a preset.

    Attributes:
        preset: with its parameters filled in.
        snapshot: gives the name of the frozen list of files, which may be under way.
        files: those of it that the rules see.
        unit: that the rows belong to; its sequence is the selection's id.
        name: of the selection.
    """

    preset: FilledPreset
    snapshot: Callable[[], str]
    files: Sequence[FileEntry]
    unit: Unit
    name: str


def selection_rows(store: Store, run: Run) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield a table and columns for it: labels batch by batch, then the selection's own row."""
    from tcrdata.store.columns import repeated

    positive = undecided = 0
    opened = Filesystem(store.url)
    with duckdb.connect() as connection:
        connection.execute("set global parquet_metadata_cache = true")
        rows, at_once = BATCH_ROWS // (2 if run.preset.alternatives else 1), AT_ONCE
        if read_bundles(opened):
            rows, at_once = BUNDLED_ROWS, 1
        batches = enumerate(_batches(run.files, rows))
        judged = partial(_judged, connection, opened, run)
        for part in _in_turn(judged, batches, at_once):
            positive += part.positive
            undecided += part.undecided
            columns = {name: part.labels[name] for name in part.labels.column_names}
            own = repeated(run.unit.sequence, part.labels.num_rows)
            yield "labels", {"selection_id": own, **columns}
        yield "labels", {}
        yield "selections", _own_row(run, positive, undecided)


def _judged(
    connection: duckdb.DuckDBPyConnection,
    opened: Filesystem,
    run: Run,
    batch: tuple[int, Mapping[str, Sequence[FileEntry]]],
) -> Iterator[LabelPart]:
    """Labels of a batch, which has a number and files, judged in a session of its own."""
    number, files = batch
    schema = f"batch_{number}"
    with connection.cursor() as session:
        create_views(session, opened, files, {}, schema)
        relations = {t: of_round(f"{schema}.{t}", run.unit.round) for t in EVIDENCE_TABLES}
        rows = sum(entry.rows for entry in files["proposals"])
        yield from judge(session, run.preset, relations, rows)
        session.execute(f"drop schema {schema} cascade")


def _in_turn(
    work: Callable[[_Item], Iterator[_Result]], items: Iterable[_Item], at_once: int
) -> Iterator[_Result]:
    """Results of items in order; so many are at work at once, and no more ahead of their taker.

    Where that is one, each result is handed on before the next one is made.
    """
    if at_once == 1:
        for item in items:
            yield from work(item)
        return
    with ThreadPoolExecutor(at_once) as pool:
        ahead: deque[Future[list[_Result]]] = deque()
        for item in items:
            if len(ahead) == at_once:
                yield from ahead.popleft().result()
            ahead.append(pool.submit(lambda its: list(work(its)), item))
        while ahead:
            yield from ahead.popleft().result()


def decided_by(preset: FilledPreset) -> dict[str, Any]:
    """Return what a preset decides by, as plain values."""
    return {
        "name": preset.name,
        "rules": [[rule.name, rule.select, rule.required] for rule in preset.rules],
        "preset": preset.select,
        "parameters": preset.parameters,
    }


def _own_row(run: Run, positive: int, undecided: int) -> dict[str, list[Any]]:
    """The columns of the selection's row of `selections`."""
    preset = run.preset
    row = {
        "selection_id": run.unit.sequence,
        "name": run.name,
        "preset": preset.name,
        "round": run.unit.round,
        "snapshot": run.snapshot(),
        "rules": [rule.name for rule in preset.rules],
        "rule_texts": [rule.select for rule in preset.rules],
        "required": [rule.required for rule in preset.rules],
        "preset_text": preset.select,
        "parameters": preset.parameters,
        "alternatives": json.dumps([decided_by(other) for other in preset.alternatives]),
        "proposals_judged": sum(e.rows for e in run.files if e.table == "proposals"),
        "labels": positive,
        "ignored": undecided,
    }
    return {name: [value] for name, value in row.items()}


def _batches(files: Sequence[FileEntry], rows_at_once: int) -> Iterator[dict[str, list[FileEntry]]]:
    """Files of whole sequences, in order, about so many proposals together."""
    sequences: dict[tuple[str, str], list[FileEntry]] = defaultdict(list)
    for entry in files:
        sequences[entry.unit.dataset, entry.unit.sequence].append(entry)
    batch: dict[str, list[FileEntry]] = {table: [] for table in EVIDENCE_TABLES}
    rows = 0
    for key in sorted(sequences):
        more = sum(entry.rows for entry in sequences[key] if entry.table == "proposals")
        if rows and rows + more > rows_at_once:
            yield batch
            batch, rows = {table: [] for table in EVIDENCE_TABLES}, 0
        for entry in sequences[key]:
            batch[entry.table].append(entry)
        rows += more
    if rows:
        yield batch
