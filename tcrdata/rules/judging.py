"""Judges proposals: rule after rule, survivors only, a batch of whole sequences at a time."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import duckdb

from tcrdata.rules.choosing import choose, decide
from tcrdata.rules.frame_verdicts import check_rows, named, with_frame_verdicts
from tcrdata.rules.kinds import OF_KINDS, Kinds, kinds_of, of_kinds
from tcrdata.rules.label_parts import LabelPart, label_columns, label_parts
from tcrdata.rules.panel import Seat, runs, seats
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.scopes import (
    Relations,
    count,
    handing_on,
    quoted,
    run_sql,
    scoped,
)
from tcrdata.store import schemas

_BITS = 62  # verdicts that fit into a bigint
ALIVE = "(from survivors where alive <> 0)"
"""The proposals that some preset still takes."""

_ID = "proposal_id"


def judge(
    connection: duckdb.DuckDBPyConnection, preset: FilledPreset, relations: Relations, rows: int
) -> Iterator[LabelPart]:
    """Judge every proposal of some whole sequences with a preset and its alternatives.

    Yields the labels, in order.

    Args:
        connection: a session of its own: temporary tables are left in it.
        preset: with its parameters filled in.
        relations: each evidence table, these sequences' rows of one round.
        rows: how many proposals there are.

    Raises:
        RuleError: a rule gives not one row a proposal, or the preset's select gives a proposal
            twice, a state or a score that there is not, or SQL fails on the rows.
    """
    presets = (preset, *preset.alternatives)
    panel = seats(presets)
    judged, kinds, relations = _opened(connection, presets, panel, relations)
    shown = set(label_columns())
    before = _everybody(presets, panel, _columns(presets, panel) | shown, relations, kinds)
    listed = runs(judged)
    left = rows
    for place, run in enumerate(listed):
        if left:
            columns = _columns(presets, [seat for later in listed[place + 1 :] for seat in later])
            if not place:
                columns |= shown
            left = _keep_survivors(connection, run, place, columns, before, left, relations)
            before = ALIVE
    if left:
        choose(connection, presets, relations)
        decide(connection, presets)
        yield from label_parts(connection, presets, panel)


def _opened(
    connection: duckdb.DuckDBPyConnection,
    presets: Sequence[FilledPreset],
    panel: Sequence[Seat],
    relations: Relations,
) -> tuple[Sequence[Seat], Kinds | None, Relations]:
    """What the rules that open presets leave to do: rules, kinds that they told apart, relations.

    Sources of which nothing passes are left out.
    """
    texts = {preset.rules[0].select for preset in presets}
    first = [seat for seat in panel if seat.rule.select in texts]
    opening = [seat for seat in first if seat.streams and seat.rule.reads.passes_id]
    kinds: Kinds | None = None
    if opening:
        passing = _let_through(presets, panel, opening, relations)
        if _names(opening) <= OF_KINDS:
            listed_names = _listed({"source", *_names(opening)})
            kept = f"select {listed_names}, carried, alive from {passing}"
            run_sql(connection, f"create temp table kinds as {kept}", named(opening))
            passing, kinds = "kinds", kinds_of(connection)
        relations = _of_sources(connection, passing, named(opening), relations)
    judged = [seat for seat in panel if seat not in opening]
    if not kinds or not judged or not judged[0].streams:
        return panel, None, relations
    return judged, kinds, relations


def _everybody(
    presets: Sequence[FilledPreset],
    panel: Sequence[Seat],
    columns: Collection[str],
    relations: Relations,
    kinds: Kinds | None = None,
) -> str:
    """SQL of the proposals before the first rule, or after those that know only `kinds`.

    `carried` has a bit for each rule that passed, `alive` one for each preset that none failed.
    """
    wide = "hugeint" if len(panel) > _BITS else "bigint"
    carried, alive = ("0", str((1 << len(presets)) - 1)) if kinds is None else of_kinds(kinds)
    return (
        f"(select {_listed(columns)}, ({carried})::{wide} as carried, ({alive})::bigint as alive "
        f"from {relations['proposals']})"
    )


def _columns(presets: Sequence[FilledPreset], rules: Sequence[Seat]) -> set[str]:
    """Columns of `proposals` that some rules or the presets' selects read."""
    reads = [*(preset.reads for preset in presets), *(seat.rule.reads for seat in rules)]
    return {_ID, *(name for read in reads for name in read.named)}


def _listed(columns: Collection[str]) -> str:
    """Columns of `proposals` in the order of the schema."""
    return ", ".join(name for name, *_ in schemas.columns("proposals") if name in columns)


def _let_through(
    presets: Sequence[FilledPreset],
    panel: Sequence[Seat],
    opening: Sequence[Seat],
    relations: Relations,
) -> str:
    """SQL of what the presets' opening rules let through, with few columns read.

    Rules say the same of rows that are alike in what the rules name, so one of them stands for all.
    """
    named = {"source", *_names(opening)}
    types = {column.name: column.type for column in schemas.columns("proposals")}
    once = "distinct " * all(types[name] == "varchar" for name in named)
    alike = f"(select {once}{_listed(named)} from {relations['proposals']})"
    nameless = f"(select '' as {_ID}, * from {alike})"
    everybody = _everybody(presets, panel, named | {_ID}, {"proposals": nameless})
    return f"(from {_streamed(opening, everybody, relations)} where alive <> 0)"


def _names(rules: Sequence[Seat]) -> set[str]:
    """Columns of `proposals` that some rules name, but the id."""
    return {name for seat in rules for name in seat.rule.reads.named} - {_ID}


def _of_sources(
    connection: duckdb.DuckDBPyConnection, passing: str, what: str, relations: Relations
) -> Relations:
    """Relations without the sources of which nothing passes: a file holds one source."""
    sql = f"select distinct source from {passing} order by 1"
    rows = run_sql(connection, sql, what).fetchall()
    listed = [quoted(source) for (source,) in rows]
    kept = f"source in ({', '.join(listed) or 'null'})"
    return {
        **relations,
        "proposals": f"(select * from {relations['proposals']} where {kept})",
        "confidences": f"(select * from {relations['confidences']} where {kept} or source is null)",
    }


def _keep_survivors(
    connection: duckdb.DuckDBPyConnection,
    run: Sequence[Seat],
    place: int,
    columns: Collection[str],
    before: str,
    rows_before: int,
    relations: Relations,
) -> int:
    """Let `survivors` show what these rules leave alive; return how many that are.

    What the first rules leave, with all that labels show, stays in `kept`: a survivor's `number` is
    its row there. Later ones copy only the columns given, which some later rule reads.
    A rule that joins gives a row each: its rows are counted before the dead are passed over.
    """
    checked = run[0].streams or run[0].of_frames
    if run[0].streams:
        after = _streamed(run, before, relations)
    elif run[0].of_frames:
        after = _tallied(run, with_frame_verdicts(connection, run, place, before, relations))
    else:
        after = _joined(run[0], before, relations)
    table, number = (f"kept_{place}", ", number") if place else ("kept", "")
    remaining = f"select {_listed(columns)}, carried, alive{number} from {after}"
    remaining += " where alive <> 0" if checked else ""
    run_sql(connection, f"create temp table {table} as {remaining}", named(run))
    if not checked:
        check_rows(run[0], count(connection, table), rows_before)
    numbered = "*" if place else "*, rowid as number"
    connection.execute(f"create or replace temp view survivors as select {numbered} from {table}")
    return count(connection, ALIVE)


def _streamed(run: Sequence[Seat], before: str, relations: Relations) -> str:
    """SQL of the rows after rules that go row by row: each hands all columns on to the next.

    Those that join see what the others leave alive alone.
    """
    alone = [seat for seat in run if not seat.joins]
    rows = _row_by_row(alone, before, relations) if alone else before
    for seat in run[len(alone) :]:
        rows = _row_by_row([seat], f"(from {rows} where alive <> 0)", relations)
    return rows


def _row_by_row(run: Sequence[Seat], before: str, relations: Relations) -> str:
    """SQL of the rows after some rules, none of which sees what another decides."""
    rows = before
    for seat in run:
        rows = _with_verdict(seat, rows, relations)
    return _tallied(run, rows)


def _tallied(run: Sequence[Seat], rows: str) -> str:
    """SQL of the rows after some rules, of rows that have their verdicts in `passed_<number>`."""
    passed = [f"case when passed_{seat.number} then {1 << seat.number} else 0 end" for seat in run]
    failed = [seat.failed(f"passed_{seat.number}") for seat in run]
    return (
        f"(select * replace (carried | {' | '.join(passed)} as carried, "
        f"alive & ~({' | '.join(failed)})::bigint as alive) from {rows})"
    )


def _with_verdict(seat: Seat, rows: str, relations: Relations) -> str:
    """SQL of the rows with a column more: what a rule that hands the id on says of each.

    Where its text is not the usual one, a row goes through it as one value in the id's place.
    """
    rule = seat.rule
    as_named = f"passed as passed_{seat.number}"
    whole = handing_on(rule.select, "{p}.*")
    if whole:
        verdicts = scoped(whole, rule.reads.tables, {**relations, "proposals": rows})
        return f"(select * exclude (value, bound, passed), {as_named} from ({verdicts}\n))"
    packed = f"(select * replace (s as {_ID}) from {rows} s)"
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": packed})
    return f"(select kept.*, {as_named} from (select {_ID} as kept, passed from ({verdicts}\n)))"


def _joined(seat: Seat, before: str, relations: Relations) -> str:
    """SQL of the rows after a rule that joins, the cheapest way that it allows.

    A number that is lost or doubled shows in the count of rows, as whole rows would.
    """
    rule = seat.rule
    if seat.hands_on:
        return _after(seat, _with_verdict(seat, before, relations), f"passed_{seat.number}")
    numbered = before == ALIVE and rule.reads.passes_id
    rows = before
    if numbered:  # a row's number travels through the rule, not the row
        rows = f"(select * replace (number as {_ID}) from survivors where alive <> 0)"
    elif rule.reads.passes_id:
        return _after(seat, _with_verdict(seat, before, relations), f"passed_{seat.number}")
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": rows})
    left, key = ("left join survivors", "number") if numbered else (f"join {before}", _ID)
    return _after(
        seat,
        f"(select s.*, v.passed from ({verdicts}\n) v {left} s on s.{key} = v.{_ID})",
        "passed",
    )


def _after(seat: Seat, rows: str, passed: str) -> str:
    """SQL of the rows after a rule, of rows that have its verdict."""
    return (
        f"(select * replace (carried | case when {passed} then {1 << seat.number} else 0 end "
        f"as carried, alive & ~({seat.failed(passed)})::bigint as alive) from {rows})"
    )
