"""The rows of `labels`, in order, a part at a time: one is written while the next is sorted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from tcrdata.rules.panel import Seat
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.scopes import quoted
from tcrdata.store import schemas

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa

_PART_ROWS = 131_072
"""Labels put in order at once, and the rest of a drive: a row group of the file that they go to."""


@dataclass(frozen=True)
class LabelPart:
    """The labels of some whole drives.

    Attributes:
        labels: the columns of `labels` but selection_id; by dataset, sequence, frame and id.
        positive: how many of them are positive.
        undecided: how many of them are left undecided.
    """

    labels: pa.Table
    positive: int
    undecided: int


@dataclass(frozen=True)
class _Drive:
    """How many labels a drive has, and the least and greatest of their numbers."""

    dataset: str
    sequence: str
    positive: int
    undecided: int
    least: int
    greatest: int


def label_columns() -> list[str]:
    """Names of the columns of `labels` but selection_id, in order."""
    return [name for name, *_ in schemas.columns("labels") if name != "selection_id"]


def label_parts(
    connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset], panel: Sequence[Seat]
) -> Iterator[LabelPart]:
    """Yield the accepted proposals and those left undecided.

    Args:
        connection: has `kept` and `decided`.
        presets: the one that decides, then its alternatives.
        panel: their rules.
    """
    carriers = _carriers(connection, presets, panel)
    columns = _columns(presets)
    for positive, undecided, chosen in _parts(connection):
        rows = connection.sql(
            f"select {columns} from decided d join kept p on p.rowid = d.number "
            "join carriers c on c.carried = d.carried and c.place = d.place "
            f"where {chosen} order by p.dataset, p.sequence, p.frame, p.proposal_id"
        ).to_arrow_table()
        yield LabelPart(_named(rows, carriers), positive, undecided)


def _parts(connection: duckdb.DuckDBPyConnection) -> Iterator[tuple[int, int, str]]:
    """Positive and undecided labels of each part, and SQL of which those are."""
    ((positive, undecided),) = connection.execute(
        "select count(*) filter (state = 'positive'), count(*) filter (state = 'ignore') "
        "from decided"
    ).fetchall()
    if positive + undecided <= _PART_ROWS:
        yield positive, undecided, "true"
        return
    for drives in _cut(_drives(connection)):
        counts = [(drive.positive, drive.undecided) for drive in drives]
        positive, undecided = (sum(numbers) for numbers in zip(*counts, strict=True))
        yield positive, undecided, _any_of(drives)


def _drives(connection: duckdb.DuckDBPyConnection) -> list[_Drive]:
    """Drives that have labels, in order."""
    found = connection.execute(
        """
        select p.dataset, p.sequence, count(*) filter (d.state = 'positive'),
               count(*) filter (d.state = 'ignore'), min(d.number), max(d.number)
        from decided d join kept p on p.rowid = d.number
        group by all order by all
        """
    ).fetchall()
    return [_Drive(*row) for row in found]


def _cut(drives: Sequence[_Drive]) -> Iterator[list[_Drive]]:
    """Drives in parts, each but the last one with enough labels for a row group."""
    part: list[_Drive] = []
    rows = 0
    for drive in drives:
        part.append(drive)
        rows += drive.positive + drive.undecided
        if rows >= _PART_ROWS:
            yield part
            part, rows = [], 0
    if part:
        yield part


def _any_of(drives: Sequence[_Drive]) -> str:
    """SQL of whether proposals p, and what was decided d, are of drives that follow one another.

    Numbers say it of few others: files are read drive by drive.
    """
    spans = []
    for dataset, group in groupby(drives, key=lambda drive: drive.dataset):
        names = [drive.sequence for drive in group]
        between = f"between {quoted(names[0])} and {quoted(names[-1])}"
        spans.append(f"(p.dataset = {quoted(dataset)} and p.sequence {between})")
    least, greatest = min(d.least for d in drives), max(d.greatest for d in drives)
    return f"d.number between {least} and {greatest} and ({' or '.join(spans)})"


def _carriers(
    connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset], panel: Sequence[Seat]
) -> list[list[str]]:
    """Names of the rules that passed a proposal for the preset of its `place`, each list once.

    Makes the table `carriers`, which has the number of each.
    """
    connection.execute(
        "create temp table carriers as "
        "select carried, place, (row_number() over () - 1)::integer as number "
        "from (select distinct carried, place from decided)"
    )
    bits = {seat.rule.select: 1 << seat.number for seat in panel}
    rows = connection.execute("select carried, place from carriers order by number").fetchall()
    return [
        [rule.name for rule in presets[place].rules if carried & bits[rule.select]]
        for carried, place in rows
    ]


def _columns(presets: Sequence[FilledPreset]) -> str:
    """SQL of a label's columns from proposals p, what was decided d, and carriers c."""
    others = "".join(
        f" when {place} then {quoted(p.name)}" for place, p in enumerate(presets) if place
    )
    made = {
        "state": "d.state",
        "score": "d.score",
        "ignored_because": f"case d.place when 0 then null{others} end",
        "carried_by": "c.number",
    }
    return ", ".join(f"{made.get(name, f'p.{name}')} as {name}" for name in label_columns())


def _named(rows: pa.Table, carriers: Sequence[Sequence[str]]) -> pa.Table:
    """Rows with the names of rules in the place of the number of their carrier.

    DuckDB and Arrow handle a few whole numbers much sooner than lists of texts.
    """
    from tcrdata.store.columns import text_lists
    from tcrdata.store.table_arrays import whole_numbers

    place = rows.column_names.index("carried_by")
    lists = text_lists(carriers, whole_numbers(rows["carried_by"]))
    return rows.set_column(place, "carried_by", lists)
