"""Judges proposals: rule after rule, survivors only, a batch of whole sequences at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import duckdb
import pyarrow as pa

from tcrdata.errors import RuleError
from tcrdata.rules.presets import FilledPreset, FilledRule
from tcrdata.store import schemas

Relations = Mapping[str, str]
"""Evidence table to the SQL that stands for it behind `from`."""


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
    """Judge every proposal of some whole sequences.

    Args:
        connection: temporary tables are made and dropped in it.
        preset: with its parameters filled in.
        relations: each evidence table, these sequences' rows of one round.

    Raises:
        RuleError: a rule gives not one row a proposal, or the preset's select gives a proposal
            twice, a state or a score that there is not, or SQL fails on the rows.
    """
    columns = ", ".join(_columns(preset))
    before = f"(select {columns}, 0::bigint as carried from {relations['proposals']})"
    judged = left = _count(connection, before)
    for run in _runs(preset):
        if left:
            left = _keep_survivors(connection, run, before, left, relations)
            before = "survivors"
    if left:
        _choose(connection, preset, relations)
    labels = _labels(connection, preset, relations) if left else _no_labels()
    for table in ("survivors", "chosen"):
        connection.execute(f"drop table if exists {table}")
    return Judgement(judged, labels)


def _columns(preset: FilledPreset) -> list[str]:
    """Columns of `proposals` that the rules or the preset's select read, and `source`."""
    read = {
        name for reads in (preset.reads, *(r.reads for r in preset.rules)) for name in reads.columns
    }
    return [name for name, *_ in schemas.columns("proposals") if name in {"source", *read}]


def _runs(preset: FilledPreset) -> list[list[tuple[int, FilledRule]]]:
    """Numbered rules in order; those that go row by row are run in one statement with the last."""
    runs: list[list[tuple[int, FilledRule]]] = []
    streams = False
    for numbered in enumerate(preset.rules):
        goes_on, streams = streams, _streams(numbered[1])
        if goes_on and streams:
            runs[-1].append(numbered)
        else:
            runs.append([numbered])
    return runs


def _streams(rule: FilledRule) -> bool:
    """Whether a proposal's row goes in and comes out, so that there is nothing to check."""
    return rule.reads.passes_id and rule.reads.row_by_row


def _keep_survivors(
    connection: duckdb.DuckDBPyConnection,
    run: list[tuple[int, FilledRule]],
    before: str,
    rows_before: int,
    relations: Relations,
) -> int:
    """Replace the survivors by those that these rules let pass; return how many."""
    what = "rule " + " or ".join(rule.name for _, rule in run)
    passing = before
    for number, rule in run:
        judge_rows = _with_rows if rule.reads.passes_id else _joined
        verdicts = judge_rows(rule, passing, relations)
        if not _streams(rule):
            _check_rows(connection, verdicts, what, rows_before)
        passed = "passed" if rule.required else "passed is not false"
        carried = f"kept.carried | case when passed then {1 << number} else 0 end"
        passing = (
            f"(select kept.* exclude (carried), {carried} as carried "
            f"from ({verdicts}) where {passed})"
        )
    _run(connection, f"create or replace temp table remaining as from {passing}", what)
    connection.execute("drop table if exists survivors")
    connection.execute("alter table remaining rename to survivors")
    return _count(connection, "survivors")


def _check_rows(
    connection: duckdb.DuckDBPyConnection, verdicts: str, what: str, before: int
) -> None:
    """A rule gives as many rows as there are proposals."""
    rows = _run(connection, f"select count(*) from ({verdicts})", what).fetchall()[0][0]
    if rows != before:
        raise RuleError(
            f"{what} gives {rows} rows for {before} proposals; it must give one row each: "
            "use a left join on keys that match one row"
        )


def _with_rows(rule: FilledRule, before: str, relations: Relations) -> str:
    """SQL of (kept, passed): the whole row of a proposal and what the rule says of it.

    The row travels through the rule in the place of its id, which the rule hands on untouched;
    so there is nothing to join afterwards, and filters reach the files.
    """
    rows = f"(select * replace (s as proposal_id) from {before} s)"
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": rows})
    return f"select proposal_id as kept, passed from ({verdicts}\n)"


def _joined(rule: FilledRule, before: str, relations: Relations) -> str:
    """As `_with_rows`, for a rule that does more with the id than to hand it on."""
    verdicts = scoped(rule.select, rule.reads.tables, {**relations, "proposals": before})
    return (
        f"select s as kept, v.passed from ({verdicts}\n) v "
        f"join {before} s on s.proposal_id = v.proposal_id"
    )


def _choose(
    connection: duckdb.DuckDBPyConnection, preset: FilledPreset, relations: Relations
) -> None:
    """Run the preset's select over the survivors and check what it gives."""
    select = scoped(preset.select, preset.reads.tables, {**relations, "proposals": "survivors"})
    what = f"the select of preset {preset.name}"
    _run(connection, f"create or replace temp table chosen as from ({select}\n)", what)
    for wrong, message in (
        ("group by proposal_id having count(*) > 1", "gives a proposal twice"),
        ("anti join survivors using (proposal_id)", "gives a proposal that no rule passed on"),
        ("where state is null or state not in ('positive', 'ignore')",
         "gives a state that is neither positive nor ignore"),
        ("where score is null or not score between 0 and 1", "gives a score outside 0 to 1"),
    ):  # fmt: skip
        rows = connection.execute(
            f"select min(proposal_id) from (select proposal_id from chosen {wrong})"
        ).fetchall()
        if rows[0][0] is not None:
            raise RuleError(f"{what} {message}: {rows[0][0]}")


def _labels(
    connection: duckdb.DuckDBPyConnection, preset: FilledPreset, relations: Relations
) -> pa.Table:
    """The chosen proposals with all columns of `labels`."""
    names = ", ".join(
        f"case when s.carried & {1 << number} <> 0 then '{rule.name}' end"
        for number, rule in enumerate(preset.rules)
    )
    made = {
        "state": "c.state",
        "score": "c.score",
        "carried_by": f"[name for name in [{names}] if name is not null]",
    }
    columns = ", ".join(
        f"{made.get(name, f'p.{name}')} as {name}" for name in _no_labels().column_names
    )
    sources = "select list(distinct source order by source) from survivors"
    quoted = [f"'{source}'" for source in connection.execute(sources).fetchall()[0][0]]
    return connection.sql(
        f"select {columns} from {relations['proposals']} p join chosen c using (proposal_id) "
        f"join survivors s using (proposal_id) where p.source in ({', '.join(quoted)}) "
        "order by p.dataset, p.sequence, p.frame, p.proposal_id"
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
