"""Rules that look at nothing but a proposal's frame: judged a frame at a time, then joined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tcrdata.errors import RuleError
from tcrdata.rules.panel import Seat
from tcrdata.rules.scopes import FRAME_COLUMNS, Relations, count, judged_frames, run_sql

if TYPE_CHECKING:
    import duckdb

_ONE_EACH = "it must give one row each: use a left join on keys that match one row"


def with_frame_verdicts(
    connection: duckdb.DuckDBPyConnection,
    run: Sequence[Seat],
    place: int,
    before: str,
    relations: Relations,
) -> str:
    """SQL of some proposals with `passed_<number>` of each of these rules.

    Makes the tables `frames_<place>` and `verdicts_<place>`: the join sees that they are small.

    Args:
        connection: gets the tables.
        run: rules that judge frames.
        place: of the run among the others.
        before: SQL of the proposals.
        relations: each evidence table.

    Raises:
        RuleError: a rule gives not one row a frame, or fails on the rows.
    """
    alike = {**relations, "proposals": f"frames_{place}"}
    said = [(seat, judged_frames(seat.rule.select, seat.rule.reads, alike)) for seat in run]
    verdicts = [(seat, *found) for seat, found in said if found]
    keys = {key for *_, names in verdicts for key in names.split(", ")}
    listed = ", ".join(key for key in FRAME_COLUMNS if key in keys)
    connection.execute(
        f"create temp table frames_{place} as select distinct {listed} from {before}"
    )
    passed = "".join(f", v_{seat.number}.passed as passed_{seat.number}" for seat in run)
    joined = "".join(f" join ({sql}\n) v_{s.number} using ({names})" for s, sql, names in verdicts)
    run_sql(
        connection,
        f"create temp table verdicts_{place} as "
        f"select f.*, f.rowid as number_of_frame{passed} from frames_{place} f{joined}",
        named(run),
    )
    ((rows, different),) = connection.execute(
        f"select count(*), count(distinct number_of_frame) from verdicts_{place}"
    ).fetchall()
    if not rows == different == count(connection, f"frames_{place}"):
        for seat, sql, names in verdicts:
            of_each = f"(from {before} s join ({sql}\n) v using ({names}))"
            check_rows(seat, count(connection, of_each), count(connection, before))
        raise RuleError(f"{named(run)}: some frames come twice and others never; {_ONE_EACH}")
    others = ", ".join(f"v.passed_{seat.number}" for seat in run)
    return f"(select s.*, {others} from {before} s join verdicts_{place} v using ({listed}))"


def check_rows(seat: Seat, rows: int, proposals: int) -> None:
    """A rule gives as many rows as there are proposals; RuleError where it does not."""
    if rows != proposals:
        raise RuleError(
            f"rule {seat.rule.name} gives {rows} rows for {proposals} proposals; {_ONE_EACH}"
        )


def named(rules: Sequence[Seat]) -> str:
    """What errors call some rules that are run together."""
    return "rule " + " or ".join(seat.rule.name for seat in rules)
