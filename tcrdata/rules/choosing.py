"""What survivors become: labels, and what stays undecided."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import duckdb

from tcrdata.errors import RuleError
from tcrdata.resources import resource_folder
from tcrdata.rules.panel import Seat
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.scopes import Relations, handing_on, quoted, run_sql, scoped
from tcrdata.store import schemas

if TYPE_CHECKING:
    import pyarrow as pa

_BOX = ("x_m", "z_m", "length_m", "width_m", "yaw_rad")
"""What tells whether boxes share a place."""


def choose(
    connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset], relations: Relations
) -> None:
    """Make the table `chosen`: what each preset's select gives of its own survivors.

    `number` is the survivor's, `stranger` the id of what is none; `own` says whether the preset
    still took it. Presets whose selects are one text, and take each proposal by itself, are run
    together.
    """
    together: dict[object, list[int]] = {}
    for place, preset in enumerate(presets):
        key = preset.select if preset.reads.each_alone else place
        together.setdefault(key, []).append(place)
    into = "create temp table chosen as"
    for places in together.values():
        first = presets[places[0]]
        given = _given(first, places, relations)
        run_sql(connection, f"{into} {given}", f"the select of preset {first.name}")
        into = "insert into chosen"
    if not _all_sound(connection):
        for place, preset in enumerate(presets):
            _check_chosen(connection, place, f"the select of preset {preset.name}")


def _given(preset: FilledPreset, places: Sequence[int], relations: Relations) -> str:
    """SQL of what a select gives for the presets of some places; the first has what is no one's."""
    bits = ", ".join(f"({place}, {1 << place}::bigint)" for place in places)
    mask = sum(1 << place for place in places)
    own = f"(from survivors where alive & {mask} <> 0)"
    scope = {**relations, "proposals": own}
    numbered = None
    if preset.reads.each_alone:
        numbered = handing_on(preset.select, "{p}.number, {p}.carried, {p}.alive")
    if numbered:
        given = scoped(numbered, preset.reads.tables, scope)
        found = "true as own, null::varchar as stranger"
        source = f"({given}\n) c join"
    else:
        given = scoped(preset.select, preset.reads.tables, scope)
        found = "b.place is not null as own, if(c.number is null, c.proposal_id, null) as stranger"
        source = (
            f"(select c.*, s.number, s.carried, s.alive from ({given}\n) c "
            "left join survivors s on s.proposal_id = c.proposal_id) c left join"
        )
    return (
        f"select c.number, c.carried, c.state, c.score, coalesce(b.place, {places[0]}) as place, "
        f"{found} from {source} (values {bits}) b(place, bit) on c.alive & b.bit <> 0"
    )


def _all_sound(connection: duckdb.DuckDBPyConnection) -> bool:
    """Whether all that was chosen is as it must be: one look, of which nearly always is no more."""
    ((sound,),) = connection.execute(
        """
        select count(*) = count(distinct (number * 64 + place))
               and count(*) = count(*) filter (own and state in ('positive', 'ignore')
                                               and score between 0 and 1)
        from chosen
        """
    ).fetchall()
    return bool(sound)


def _check_chosen(connection: duckdb.DuckDBPyConnection, place: int, what: str) -> None:
    """A preset chooses some of its survivors, each once, with a state and a score that there is."""
    (wrong,) = connection.execute(
        f"""
        select min(proposal_id) filter (times > 1), min(proposal_id) filter (strange),
               min(proposal_id) filter (no_state), min(proposal_id) filter (no_score)
        from (
            select coalesce(stranger, any_value(s.proposal_id)) as proposal_id, count(*) as times,
                   bool_or(not own) as strange,
                   bool_or(state is null or state not in ('positive', 'ignore')) as no_state,
                   bool_or(score is null or not score between 0 and 1) as no_score
            from chosen
            left join survivors s using (number)
            where place = {place}
            group by number, stranger
        )
        """
    ).fetchall()
    messages = (
        "gives a proposal twice",
        "gives a proposal that no rule passed on",
        "gives a state that is neither positive nor ignore",
        "gives a score outside 0 to 1",
    )
    for proposal, message in zip(wrong, messages, strict=True):
        if proposal is not None:
            raise RuleError(f"{what} {message}: {proposal}")


def labels_of(
    connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset], panel: Sequence[Seat]
) -> pa.Table:
    """The accepted proposals and those left undecided, with all columns of `labels`."""
    _decide(connection, presets)
    return connection.sql(
        f"with carriers as (select carried, place, {_carried_by(presets, panel)} as carried_by "
        "from (select distinct carried, place from decided)) "
        f"select {_label_columns(presets)} from decided d join kept p on p.rowid = d.number "
        "join carriers c on c.carried = d.carried and c.place = d.place "
        "order by p.dataset, p.sequence, p.frame, p.proposal_id"
    ).to_arrow_table()


def _decide(connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset]) -> None:
    """Let `decided` show state and score of what becomes a label, and for which preset."""
    if len(presets) == 1:
        connection.execute("create temp view decided as from chosen")
        return
    # A survivor's number stands for its id: whole numbers are compared sooner than texts.
    where = ", ".join(f"k.{name}" for name in ("dataset", "sequence", "frame", *_BOX))
    connection.execute(
        f"create temp table candidates as select c.number as proposal_id, c.*, {where} "
        "from chosen c join kept k on k.rowid = c.number"
    )
    path = resource_folder("queries") / "states" / "ignore.sql"
    undecided = scoped(
        path.read_text(encoding="utf-8"),
        ("accepted", "acceptable"),
        {
            "accepted": "(select * from candidates where place = 0)",
            "acceptable": "(select * from candidates where place > 0)",
        },
    )
    connection.execute(
        "create temp table decided as "
        "select number, state, score, carried, place from candidates where place = 0 union all "
        f"select number, 'ignore', score, carried, place from ({undecided})"
    )


def labels_in(connection: duckdb.DuckDBPyConnection) -> tuple[int, int]:
    """How many of the labels that `labels_of` gave are positive, and how many undecided."""
    ((positive, undecided),) = connection.execute(
        "select count(*) filter (state = 'positive'), count(*) filter (state = 'ignore') "
        "from decided"
    ).fetchall()
    return positive, undecided


def _carried_by(presets: Sequence[FilledPreset], panel: Sequence[Seat]) -> str:
    """SQL of the names of the rules that passed a proposal for the preset of its `place`."""
    numbers = {seat.rule.select: seat.number for seat in panel}
    lists = ""
    for place, preset in enumerate(presets):
        names = ", ".join(
            f"case when carried & {1 << numbers[rule.select]} <> 0 then {quoted(rule.name)} end"
            for rule in preset.rules
        )
        lists += f" when {place} then [{names}]"
    return f"list_filter(case place{lists} end, lambda name: name is not null)"


def _label_columns(presets: Sequence[FilledPreset]) -> str:
    """SQL of a label's columns from proposals p, what was decided d, and carriers c."""
    others = "".join(
        f" when {place} then {quoted(p.name)}" for place, p in enumerate(presets) if place
    )
    made = {
        "state": "d.state",
        "score": "d.score",
        "ignored_because": f"case d.place when 0 then null{others} end",
        "carried_by": "c.carried_by",
    }
    return ", ".join(
        f"{made.get(name, f'p.{name}')} as {name}" for name in no_labels().column_names
    )


def no_labels() -> pa.Table:
    """An empty table with the columns of `labels` but selection_id."""
    import pyarrow as pa

    schema = schemas.arrow_schema("labels")
    chosen = pa.schema([field for field in schema if field.name != "selection_id"])
    return pa.Table.from_batches([], schema=chosen)  # empty_table() would import pandas
