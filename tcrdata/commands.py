"""What each command does: calls the library, then prints."""

from __future__ import annotations

import csv
import dataclasses
import os
import sys
import time
from pathlib import Path
from typing import Any

from tcrdata import console, printing
from tcrdata.errors import MissingEvidenceError, QueryError, SettingsError
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.settings import parse_assignments, read_toml

MOST_WORKERS_BY_DEFAULT = 8
ROWS_A_WRITE = 10_000


def run_build(
    *,
    dataset: str,
    root: str,
    store_url: str,
    sequences: tuple[str, ...] | None,
    frames: str | None,
    rounds: int,
    presets: tuple[str, ...],
    workers: int | None,
    config: str | None,
    assignments: list[str],
    only_plan: bool,
    as_json: bool,
) -> int:
    """Build, print the report, and return the exit code: 1 when any unit failed."""
    from tcrdata import executors

    count = workers if workers is not None else _default_workers()
    if count < 1:
        raise SettingsError(f"--workers {count}: at least one is needed")
    if count > 1 and not only_plan:
        executors.start_server()
    from tcrdata import pipeline
    from tcrdata.dry_runs import dry_run

    if rounds != 1:
        raise SettingsError(
            f"--rounds {rounds}: this version makes round 1; later rounds need learned modules"
        )
    values = {**(read_toml(config) if config else {}), **parse_assignments(assignments)}
    plan = pipeline.plan_build(
        dataset,
        root,
        sequences=sequences,
        frames=parse_frame_ranges(frames),
        presets=presets,
        assignments=values,
    )
    started = time.perf_counter()
    if only_plan:
        report = dry_run(plan, store_url)
    else:
        total = len(plan.sequences) * (2 + len(plan.cues))
        with console.build_progress(total) as progress:
            report = pipeline.build(plan, store_url, workers=count, progress=progress)
    seconds = time.perf_counter() - started
    if as_json:
        console.print_json(printing.build_json(report, seconds))
    else:
        printing.print_build(report, plan.sequences, store_url, seconds, only_plan=only_plan)
    return 1 if report.count("failed") else 0


def run_check(
    store_url: str, preset: str, assignments: list[str], name: str | None, *, as_json: bool
) -> int:
    """Select labels and print how many."""
    from tcrdata.rules import select
    from tcrdata.store import open_store

    started = time.perf_counter()
    selection = select(
        open_store(store_url), preset, overrides=parse_assignments(assignments), name=name
    )
    seconds = time.perf_counter() - started
    if as_json:
        console.print_json(printing.selection_json(selection))
    else:
        printing.print_selection(selection)
        console.say(f"selected in {seconds:.2f} s; next: tcrdata evaluate --store {store_url}")
    return 0


def run_sql(store_url: str, query: str, *, as_json: bool, as_csv: bool) -> int:
    """Run a query and print its rows."""
    import duckdb

    import tcrdata

    if as_json and as_csv:
        raise SettingsError("--json and --csv: choose one")
    handle = tcrdata.open(store_url)
    try:
        if not as_json and not as_csv:
            relation = handle.sql(query)
            sys.stdout.write(f"{relation}\n" if relation is not None else "")
            return 0
        cursor = handle.connection.execute(query)
        names = [column[0] for column in cursor.description or ()]
        if as_json:
            rows = cursor.fetchall()
            console.print_json([dict(zip(names, row, strict=True)) for row in rows])
            return 0
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(names)
        while rows := cursor.fetchmany(ROWS_A_WRITE):
            writer.writerows(rows)
    except duckdb.Error as error:
        raise QueryError(" ".join(str(error).split())) from error
    return 0


def run_evaluate(store_url: str, selection: str | None, *, moving_only: bool, as_json: bool) -> int:
    """Score a selection; print the protocol first, then the scores."""
    from tcrdata.evaluation.protocol import Settings
    from tcrdata.evaluation.scoring import evaluate, store_metrics
    from tcrdata.plan import ROUND
    from tcrdata.store import open_store

    store = open_store(store_url)
    settings = Settings(moving_only=moving_only)
    result = evaluate(store, _selected(store, selection), settings)
    store_metrics(store, result, settings, ROUND)
    if as_json:
        console.print_json(result.to_json())
        return 0
    sys.stdout.write(result.protocol + "\n\n")
    for name in result.without_truth:
        console.say(f"left out: {name} has no ground truth")
    rows = _score_rows(result, ("moving",) if moving_only else ("all", "moving"))
    console.print_table("", ("score", "view", *map(str, settings.ious)), rows)
    return 0


def _score_rows(result: Any, subsets: tuple[str, ...]) -> list[tuple[Any, ...]]:
    """One row a metric, subset and view, over all sequences; precision knows no subset."""
    from tcrdata.evaluation.protocol import VIEWS
    from tcrdata.evaluation.scoring import METRICS

    rows: list[tuple[Any, ...]] = []
    for metric in METRICS:
        for subset in subsets[:1] if metric == "precision" else subsets:
            for view in VIEWS:
                found = result.find(subset, view, metric)
                values = [found[iou].value for iou in sorted(found)]
                name = metric.replace("_", " ")
                rows.append((name if metric == "precision" else f"{name}, {subset}", view, *values))
    return rows


def run_export(
    format_name: str,
    store_url: str,
    selection: str | None,
    out: str,
    *,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Export a selection; print the format's card."""
    from tcrdata import registry
    from tcrdata.store import open_store

    store = open_store(store_url)
    exporter = registry.find("exporters", format_name)
    card = exporter.export(store, _selected(store, selection), out, overwrite=overwrite)
    if as_json:
        console.print_json(dataclasses.asdict(card))
    else:
        sys.stdout.write(card.text() + "\n")
    return 0


def run_status(store_url: str, *, as_json: bool) -> int:
    """Print what a store holds and lacks."""
    from tcrdata.status import store_status
    from tcrdata.store import open_store

    found = store_status(open_store(store_url))
    if as_json:
        console.print_json(found.as_dict())
        return 0
    console.print_table(
        "units", ("done", "failed", "missing"), [(found.done, found.failed, found.missing)]
    )
    console.print_table("tables", ("table", "rows", "bytes", "files"), found.tables)
    if found.problems:
        console.print_table("problems", ("where", "frame", "what"), found.problems)
    if found.selections:
        console.print_table("selections", ("id", "name", "labels"), found.selections)
    if found.missing:
        console.say("run the same build again to make what is missing")
    return 0


def run_draw(
    store_url: str,
    out: str,
    selection: str | None,
    sequence: str | None,
    frames: str | None,
    *,
    truth: bool,
) -> int:
    """Draw frames of a sequence; print the paths."""
    from tcrdata.pictures import draw_frames
    from tcrdata.store import open_store

    store = open_store(store_url)
    chosen = _selected(store, selection)
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"--out {out}: {error.strerror}: give another folder") from error
    for path in draw_frames(store, chosen, folder, sequence, frames, with_truth=truth):
        sys.stdout.write(f"{path}\n")
    return 0


def run_views(store_url: str) -> int:
    """Print the definitions of a store's views, in an order in which a DuckDB shell can read them.

    Raises:
        StoreError: the store is not a local folder, which a shell could not read by itself.
    """
    import tcrdata
    from tcrdata.errors import StoreError

    if "://" in store_url and not store_url.startswith("file:"):
        raise StoreError(f"{store_url}: views are for a store in a local folder: copy it to one")
    handle = tcrdata.open(store_url)
    definitions = handle.connection.execute(
        """
        select 'create schema if not exists ' || schema_name || ';'
        from duckdb_schemas() where not internal and schema_name <> 'main'
        union all
        (select sql from duckdb_tables() where not internal order by table_oid)
        union all
        (select sql from duckdb_views() where not internal order by view_oid)
        """
    ).fetchall()
    for (sql,) in definitions:
        sys.stdout.write(f"{sql}\n")
    return 0


def run_warm() -> int:
    """Compile the kernels and say how long it took."""
    from tcrdata.warming import warm

    started = time.perf_counter()
    warm()
    console.say(f"kernels are compiled ({time.perf_counter() - started:.1f} s)")
    return 0


def _selected(store: Any, name: str | None) -> str:
    chosen = store.newest_selection(name)
    if chosen is None:
        known = sorted({row["name"] for row in store.read("selections").to_pylist()})
        what = f"no selection '{name}'; there are: {', '.join(known) or 'none'}"
        if name is None:
            what = "the store has no selection yet: run tcrdata check --preset tcrdata"
        raise MissingEvidenceError(f"{store.url}: {what}")
    return str(chosen)


def _default_workers() -> int:
    return min(len(os.sched_getaffinity(0)), MOST_WORKERS_BY_DEFAULT)
