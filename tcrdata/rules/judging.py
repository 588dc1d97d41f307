"""Judges proposals: rule after rule, survivors only, a batch of whole sequences at a time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import duckdb
import pyarrow as pa

from tcrdata.errors import RuleError
from tcrdata.rules.choosing import choose, labels_in, labels_of, no_labels
from tcrdata.rules.panel import Seat, runs, seats
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.scopes import Relations, count, run_sql, scoped
from tcrdata.store import schemas

_BITS = 62  # verdicts that fit into a bigint
ALIVE = "(from survivors where alive <> 0)"
"""The proposals that some preset still takes."""

_IN_HAND = ("survivors", "remaining", "chosen", "candidates", "decided")
_BOX = ("x_m", "z_m", "length_m", "width_m", "yaw_rad")  # what tells whether boxes share a place


@dataclass(frozen=True)
class Judged:
    """What some proposals became.

    Attributes:
        labels: the columns of `labels` but selection_id; by dataset, sequence, frame and id.
        positive: how many of them are positive.
        undecided: how many of them are left undecided.
    """

    labels: pa.Table
    positive: int = 0
    undecided: int = 0


def judge(
    connection: duckdb.DuckDBPyConnection, preset: FilledPreset, relations: Relations, rows: int
) -> Judged:
    """Judge every proposal of some whole sequences with a preset and its alternatives.

    Args:
        connection: temporary tables are made and dropped in it.
        preset: with its parameters filled in.
        relations: each evidence table, these sequences' rows of one round.
        rows: how many proposals there are.

    Raises:
        RuleError: a rule gives not one row a proposal, or the preset's select gives a proposal
            twice, a state or a score that there is not, or SQL fails on the rows.
    """
    presets = (preset, *preset.alternatives)
    panel = seats(presets)
    alone = len(presets) == 1
    if not alone:  # one preset's own filter reaches the files; several together do not
        relations = _of_sources(connection, _opening(presets, panel, relations), relations)
    before = _everybody(presets, panel, _columns(presets), relations)
    left = rows if alone or not rows else count(connection, before)
    for run in runs(panel):
        if left:
            left = _keep_survivors(connection, run, before, left, relations)
            if alone and before != ALIVE:
                relations = _of_sources(connection, ALIVE, relations)
            before = ALIVE
    judged = Judged(no_labels())
    if left:
        choose(connection, presets, relations)
        labels = labels_of(connection, presets, panel, relations)
        judged = Judged(labels, *labels_in(connection))
    for table in _IN_HAND:
        connection.execute(f"drop table if exists {table}")
    return judged


def _everybody(
    presets: Sequence[FilledPreset],
    panel: Sequence[Seat],
    columns: Collection[str],
    relations: Relations,
) -> str:
    """SQL of the proposals before the first rule, with these columns.

    `carried` has a bit for each rule that passed, `alive` one for each preset that none failed.
    """
    read = ", ".join(name for name, *_ in schemas.columns("proposals") if name in columns)
    wide = "hugeint" if len(panel) > _BITS else "bigint"
    return (
        f"(select {read}, 0::{wide} as carried, {(1 << len(presets)) - 1}::bigint as alive "
        f"from {relations['proposals']})"
    )


def _columns(presets: Sequence[FilledPreset]) -> set[str]:
    """Columns of `proposals` that the rules or the presets' selects read, or a place takes."""
    reads = [r for p in presets for r in (p.reads, *(rule.reads for rule in p.rules))]
    read = {"source", *(name for r in reads for name in r.columns)}
    return read | set(_BOX) if len(presets) > 1 else read


def _opening(presets: Sequence[FilledPreset], panel: Sequence[Seat], relations: Relations) -> str:
    """SQL of what the presets' opening rules let through, with few columns read."""
    texts = {preset.rules[0].select for preset in presets}
    opening = [seat for seat in panel if seat.streams and seat.rule.select in texts]
    columns = {"source", *(name for seat in opening for name in seat.rule.reads.columns)}
    nameless = f"(select * replace ('' as proposal_id) from {relations['proposals']})"
    after = _everybody(presets, panel, columns, {"proposals": nameless})
    for seat in opening:
        after = _after(seat, f"({_with_rows(seat, after, relations)})")
    return f"(from {after} where alive <> 0)"


def _of_sources(
    connection: duckdb.DuckDBPyConnection, passing: str, relations: Relations
) -> Relations:
    """Relations without the sources of which nothing passes: a file holds one source."""
    sql = f"select distinct source from {passing} order by 1"
    rows = run_sql(connection, sql, "the rule that comes first").fetchall()
    listed = ["'" + source.replace("'", "''") + "'" for (source,) in rows]
    kept = f"source in ({', '.join(listed) or 'null'})"
    return {
        **relations,
        "proposals": f"(select * from {relations['proposals']} where {kept})",
        "confidences": f"(select * from {relations['confidences']} where {kept} or source is null)",
    }


def _keep_survivors(
    connection: duckdb.DuckDBPyConnection,
    run: Sequence[Seat],
    before: str,
    rows_before: int,
    relations: Relations,
) -> int:
    """Replace the survivors by what these rules leave alive; return how many that are.

    A rule that joins gives a row each: its rows are counted before the dead are passed over.
    """
    what = "rule " + " or ".join(seat.rule.name for seat in run)
    after = before
    for seat in run:
        judged = _with_rows if seat.rule.reads.passes_id else _joined
        after = _after(seat, f"({judged(seat, after, relations)})")
    streams = all(seat.streams for seat in run)
    alive = " where alive <> 0" if streams else ""
    run_sql(connection, f"create or replace temp table remaining as from {after}{alive}", what)
    if not streams and (rows := count(connection, "remaining")) != rows_before:
        raise RuleError(
            f"{what} gives {rows} rows for {rows_before} proposals; it must give one row each: "
            "use a left join on keys that match one row"
        )
    connection.execute("drop table if exists survivors")
    connection.execute("alter table remaining rename to survivors")
    return count(connection, ALIVE)


def _after(seat: Seat, verdicts: str) -> str:
    """SQL of the rows after a rule, of its (kept, passed)."""
    return (
        "(select kept.* replace ("
        f"kept.carried | case when passed then {1 << seat.number} else 0 end as carried, "
        f"{seat.alive_after('kept.alive')} as alive) from {verdicts})"
    )


def _with_rows(seat: Seat, before: str, relations: Relations) -> str:
    """SQL of (kept, passed): the whole row of a proposal and what the rule says of it.

    The row travels through the rule in the place of its id, which the rule hands on untouched;
    so there is nothing to join afterwards, and filters reach the files.
    """
    rows = f"(select * replace (s as proposal_id) from {before} s)"
    rule = seat.rule
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": rows})
    return f"select proposal_id as kept, passed from ({verdicts}\n)"


def _joined(seat: Seat, before: str, relations: Relations) -> str:
    """As `_with_rows`, for a rule that does more with the id than to hand it on."""
    rule = seat.rule
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": before})
    return (
        f"select s as kept, v.passed from ({verdicts}\n) v "
        f"join {before} s on s.proposal_id = v.proposal_id"
    )
