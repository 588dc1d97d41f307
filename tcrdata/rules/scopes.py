"""SQL of rules, run over whatever stands for the tables that they name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import duckdb

from tcrdata.errors import RuleError
from tcrdata.rules.tokens import tokens

if TYPE_CHECKING:
    from tcrdata.rules.binding import Reads

_HANDS_ON = re.compile(r"select\s+(\w+)\.proposal_id\s*,", re.IGNORECASE)
_PLAIN = re.compile(r"(select\b.*\bfrom)\s+proposals\s+(?:as\s+)?(\w+)", re.IGNORECASE | re.DOTALL)

FRAME_COLUMNS = ("dataset", "sequence", "frame", "round", "metric_scale")
"""Columns of `proposals` that are the same in all rows of a frame."""

Relations = Mapping[str, str]
"""Evidence table to the SQL that stands for it behind `from`."""


def scoped(select: str, tables: tuple[str, ...], relations: Relations) -> str:
    """A select that reads these relations under the names of the tables.

    A plain `select ... from proposals p` gets its relation right there: rules stand inside one
    another, and each select around a select takes its time to plan.
    """
    plain = _PLAIN.fullmatch(select)
    if plain and tables == ("proposals",) and select.lower().count("proposals") == 1:
        return f"{plain[1]} {relations['proposals']} {plain[2]}"
    scope = ",\n".join(
        f"{table} as not materialized (select * from {relations[table]})" for table in tables
    )
    return f"with {scope}\nselect * from (\n{select}\n)" if scope else select


def handing_on(select: str, columns: str) -> str | None:
    """A select of `p.proposal_id, ...` that gives these columns of `p` in the place of the id.

    None where its text starts otherwise, though it may mean the same.
    """
    span = _id_span(select)
    if span is None:
        return None
    start, end, name = span
    return f"{select[:start]}select {columns.format(p=name)},{select[end:]}"


@lru_cache(maxsize=256)
def _id_span(select: str) -> tuple[int, int, str] | None:
    """Where `select p.proposal_id,` of the outermost select starts and ends, and its `p`."""
    found = _HANDS_ON.match(select)
    if not found:
        depth, data = 0, select.encode()
        for start, word in tokens(select):
            if not depth and word.strip().lower() == "select":
                found = _HANDS_ON.match(select, len(data[:start].decode()))
                break
            depth += 0 if word[:1] in "'\"" else word.count("(") - word.count(")")
    return (*found.span(), found[1]) if found else None


def frame_keys(select: str, reads: Reads) -> list[str]:
    """The columns of the frame that a rule that joins names; empty where it names others, too."""
    keys = [name for name in reads.named if name != "proposal_id"]
    looks = reads.passes_id and not reads.row_by_row and set(keys) <= set(FRAME_COLUMNS)
    return keys if looks and handing_on(select, "") is not None else []


def judged_frames(select: str, reads: Reads, relations: Relations) -> tuple[str, str] | None:
    """What a rule that names columns of the frame alone says, a row a frame, and these columns.

    A frame's proposals are alike to it, and joins in it see a row a frame. None for other rules.
    """
    keys = frame_keys(select, reads)
    whole = handing_on(select, ", ".join(f"{{p}}.{key}" for key in keys)) if keys else None
    if not whole:
        return None
    alike = f"(select distinct {', '.join(keys)} from {relations['proposals']})"
    return scoped(whole, reads.tables, {**relations, "proposals": alike}), ", ".join(keys)


def quoted(text: str) -> str:
    """A text as SQL writes it."""
    return "'" + text.replace("'", "''") + "'"


def run_sql(
    connection: duckdb.DuckDBPyConnection, sql: str, what: str
) -> duckdb.DuckDBPyConnection:
    """Run SQL of a rule; an error in it (a cast, say) names the rule."""
    try:
        return connection.execute(sql)
    except duckdb.Error as error:
        raise RuleError(f"{what} fails on the rows: {' '.join(str(error).split())}") from error


def count(connection: duckdb.DuckDBPyConnection, relation: str) -> int:
    """Number of rows."""
    return int(connection.execute(f"select count(*) from {relation}").fetchall()[0][0])


def located(path: Path, first_line: int, error: duckdb.Error) -> str:
    """One line for a DuckDB error: file, line, what is wrong, what DuckDB suggests.

    Args:
        path: file the SQL came from.
        first_line: 1-based line in the file at which that SQL starts.
        error: its message ends with `LINE n: ...` when DuckDB knows the place.
    """
    message, _, place = str(error).partition("\n\nLINE ")
    number = place.partition(":")[0]
    line = first_line + int(number) - 1 if number.isdigit() else first_line
    return f"{path}:{line}: {' '.join(message.split())}"
