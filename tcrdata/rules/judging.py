"""Judges proposals: rule after rule, survivors only, a batch of whole sequences at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import duckdb
import pyarrow as pa

from tcrdata.errors import RuleError
from tcrdata.resources import resource_folder
from tcrdata.rules.panel import Seat, runs, seats
from tcrdata.rules.presets import FilledPreset
from tcrdata.store import schemas

Relations = Mapping[str, str]
"""Evidence table to the SQL that stands for it behind `from`."""

_BITS = 62  # verdicts that fit into a bigint
_IN_HAND = ("survivors", "remaining", "verdicts", "chosen", "accepted", "acceptable")


@dataclass(frozen=True)
class Judgement:
    """What came of a batch.

    Attributes:
        judged: proposals that the first rule saw.
        labels: columns of `labels` but selection_id; sorted by dataset, sequence, frame and id.
    """

    judged: int
    labels: pa.Table


def scoped(select: str, tables: tuple[str, ...], relations: Relations) -> str:
    """A select that reads these relations under the names of the tables."""
    scope = ",\n".join(
        f"{table} as not materialized (select * from {relations[table]})" for table in tables
    )
    return f"with {scope}\nselect * from (\n{select}\n)" if scope else select


def judge(
    connection: duckdb.DuckDBPyConnection, preset: FilledPreset, relations: Relations
) -> Judgement:
    """Judge every proposal of some whole sequences with a preset and its alternatives.

    Args:
        connection: temporary tables are made and dropped in it.
        preset: with its parameters filled in.
        relations: each evidence table, these sequences' rows of one round.

    Raises:
        RuleError: a rule gives not one row a proposal, or the preset's select gives a proposal
            twice, a state or a score that there is not, or SQL fails on the rows.
    """
    presets = (preset, *preset.alternatives)
    panel = seats(presets)
    columns = ", ".join(_columns(presets))
    everybody = (1 << len(presets)) - 1
    wide = "hugeint" if len(panel) > _BITS else "bigint"
    before = (
        f"(select {columns}, 0::{wide} as carried, {everybody}::bigint as alive "
        f"from {relations['proposals']})"
    )
    judged = left = _count(connection, before)
    for run in runs(panel):
        if left:
            left = _keep_survivors(connection, run, before, left, relations)
            relations = _of_sources(connection, relations) if before != "survivors" else relations
            before = "survivors"
    if left:
        _accept(connection, presets, panel, relations)
    labels = _labels(connection, with_ignored=len(presets) > 1) if left else _no_labels()
    for table in _IN_HAND:
        connection.execute(f"drop table if exists {table}")
    return Judgement(judged, labels)


def _columns(presets: Sequence[FilledPreset]) -> list[str]:
    """Columns of `proposals` that the rules or the presets' selects read, and `source`."""
    reads = [r for p in presets for r in (p.reads, *(rule.reads for rule in p.rules))]
    read = {"source", *(name for r in reads for name in r.columns)}
    return [name for name, *_ in schemas.columns("proposals") if name in read]


def _of_sources(connection: duckdb.DuckDBPyConnection, relations: Relations) -> Relations:
    """Relations without what belongs to proposals of other sources than the survivors'.

    Files hold one source each: those of the others need not be read again.
    """
    rows = connection.execute("select distinct source from survivors order by source").fetchall()
    listed = ", ".join("'" + source.replace("'", "''") + "'" for (source,) in rows) or "null"
    kept = f"source in ({listed})"
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
    """Replace the survivors by those that these rules let pass; return how many."""
    what = "rule " + " or ".join(seat.rule.name for seat in run)
    passing = before
    for seat in run:
        if seat.streams:
            passing = _passing(seat, f"({_with_rows(seat, passing, relations)})")
        else:
            _judge_once(connection, seat, before, rows_before, relations)
            passing = _passing(seat, "verdicts")
    _run(connection, f"create or replace temp table remaining as from {passing}", what)
    connection.execute("drop table if exists survivors")
    connection.execute("alter table remaining rename to survivors")
    return _count(connection, "survivors")


def _passing(seat: Seat, verdicts: str) -> str:
    """SQL of the rows that some preset still takes after a rule, of its (kept, passed)."""
    return (
        "(select kept.* replace ("
        f"kept.carried | case when passed then {1 << seat.number} else 0 end as carried, "
        f"{seat.alive_after('kept.alive')} as alive) from {verdicts} "
        f"where {seat.alive_after('kept.alive')} <> 0)"
    )


def _judge_once(
    connection: duckdb.DuckDBPyConnection,
    seat: Seat,
    before: str,
    rows_before: int,
    relations: Relations,
) -> None:
    """Make the table `verdicts` (kept, passed) of a rule that joins; it gives a row each."""
    what = f"rule {seat.rule.name}"
    verdicts = (_with_rows if seat.rule.reads.passes_id else _joined)(seat, before, relations)
    _run(connection, f"create or replace temp table verdicts as from ({verdicts})", what)
    rows = _count(connection, "verdicts")
    if rows != rows_before:
        raise RuleError(
            f"{what} gives {rows} rows for {rows_before} proposals; it must give one row each: "
            "use a left join on keys that match one row"
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


def _accept(
    connection: duckdb.DuckDBPyConnection,
    presets: Sequence[FilledPreset],
    panel: Sequence[Seat],
    relations: Relations,
) -> None:
    """Make the tables `accepted`, and of the alternatives `acceptable`, with a label's columns."""
    for place, preset in enumerate(presets):
        _choose(connection, preset, f"(from survivors where alive & {1 << place} <> 0)", relations)
        because = f"'{preset.name}'" if place else None
        rows = (
            f"select {_label_columns(panel, preset, because)}, {place} as place "
            f"from {relations['proposals']} p join chosen c using (proposal_id) "
            "join survivors s using (proposal_id)"
        )
        if place < 2:
            table = "acceptable" if place else "accepted"
            connection.execute(f"create or replace temp table {table} as {rows}")
        else:
            connection.execute(f"insert into acceptable {rows}")


def _choose(
    connection: duckdb.DuckDBPyConnection,
    preset: FilledPreset,
    proposals: str,
    relations: Relations,
) -> None:
    """Run a preset's select over its survivors into the table `chosen`; check what it gives."""
    select = scoped(preset.select, preset.reads.tables, {**relations, "proposals": proposals})
    what = f"the select of preset {preset.name}"
    _run(connection, f"create or replace temp table chosen as from ({select}\n)", what)
    for wrong, message in (
        ("group by proposal_id having count(*) > 1", "gives a proposal twice"),
        (f"anti join {proposals} s using (proposal_id)", "gives a proposal that no rule passed on"),
        ("where state is null or state not in ('positive', 'ignore')",
         "gives a state that is neither positive nor ignore"),
        ("where score is null or not score between 0 and 1", "gives a score outside 0 to 1"),
    ):  # fmt: skip
        rows = connection.execute(
            f"select min(proposal_id) from (select proposal_id from chosen {wrong})"
        ).fetchall()
        if rows[0][0] is not None:
            raise RuleError(f"{what} {message}: {rows[0][0]}")


def _label_columns(panel: Sequence[Seat], preset: FilledPreset, because: str | None) -> str:
    """SQL of a label's columns from proposals p, chosen c and survivors s."""
    numbers = {seat.rule.select: seat.number for seat in panel}
    names = ", ".join(
        f"case when s.carried & {1 << numbers[rule.select]} <> 0 then '{rule.name}' end"
        for rule in preset.rules
    )
    made = {
        "state": "'ignore'" if because else "c.state",
        "score": "c.score",
        "ignored_because": because or "null::varchar",
        "carried_by": f"[name for name in [{names}] if name is not null]",
    }
    return ", ".join(
        f"{made.get(name, f'p.{name}')} as {name}" for name in _no_labels().column_names
    )


def _labels(connection: duckdb.DuckDBPyConnection, *, with_ignored: bool) -> pa.Table:
    """The accepted proposals and those left undecided, with all columns of `labels`."""
    columns = ", ".join(_no_labels().column_names)
    rows = f"select {columns} from accepted"
    if with_ignored:
        path = resource_folder("queries") / "states" / "ignore.sql"
        rows += f" union all select {columns} from ({path.read_text(encoding='utf-8')}\n)"
    return connection.sql(
        f"from ({rows}) order by dataset, sequence, frame, proposal_id"
    ).to_arrow_table()


def _no_labels() -> pa.Table:
    """An empty table with the columns of `labels` but selection_id."""
    schema = schemas.arrow_schema("labels")
    return pa.schema([field for field in schema if field.name != "selection_id"]).empty_table()


def _run(connection: duckdb.DuckDBPyConnection, sql: str, what: str) -> duckdb.DuckDBPyConnection:
    """Run SQL of a rule; an error in it (a cast, say) names the rule."""
    try:
        return connection.execute(sql)
    except duckdb.Error as error:
        raise RuleError(f"{what} fails on the rows: {' '.join(str(error).split())}") from error


def _count(connection: duckdb.DuckDBPyConnection, relation: str) -> int:
    """Number of rows."""
    return int(connection.execute(f"select count(*) from {relation}").fetchall()[0][0])
