"""What survivors become: labels, and what stays undecided."""

from __future__ import annotations

from collections.abc import Sequence

import duckdb

from tcrdata.errors import RuleError
from tcrdata.resources import resource_folder
from tcrdata.rules.presets import FilledPreset
from tcrdata.rules.scopes import Relations, handing_on, run_sql, scoped

_PLACE = ("dataset", "sequence", "frame", "x_m", "z_m", "length_m", "width_m", "yaw_rad")
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
    if preset.reads.hands_on_rows:
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


def decide(connection: duckdb.DuckDBPyConnection, presets: Sequence[FilledPreset]) -> None:
    """Let `decided` show state and score of what becomes a label, and for which preset.

    Reads `chosen` and `kept`.
    """
    if len(presets) == 1:
        connection.execute("create temp view decided as from chosen")
        return
    # A survivor's number stands for its id: whole numbers are compared sooner than texts.
    relations = {
        "accepted": "(select number as proposal_id, * from chosen where place = 0)",
        "acceptable": "(select number as proposal_id, * from chosen where place > 0)",
        "proposals": f"(select rowid as proposal_id, {', '.join(_PLACE)} from kept)",
    }
    path = resource_folder("queries") / "states" / "ignore.sql"
    undecided = scoped(path.read_text(encoding="utf-8"), tuple(relations), relations)
    connection.execute(
        "create temp table decided as "
        "select number, state, score, carried, place from chosen where place = 0 union all "
        f"select number, 'ignore', score, carried, place from ({undecided})"
    )
