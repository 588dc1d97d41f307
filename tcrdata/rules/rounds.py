"""What the rules of a round read: geometry is measured once, models speak anew in each round."""

from __future__ import annotations

MEASURED = 1
"""The round whose rows every later one reads beside its own."""


def rounds_read(number: int) -> tuple[int, ...]:
    """Return the rounds whose rows a round's rules see, ascending."""
    return (MEASURED,) if number == MEASURED else (MEASURED, number)


def of_round(relation: str, number: int) -> str:
    """SQL of a table's rows for a round, all of them under its number so that joins on it hold.

    Args:
        relation: what stands behind `from`.
        number: the round.
    """
    if number == MEASURED:
        return f"(select * from {relation} where round = {MEASURED})"
    return (
        f"(select * replace ({number}::integer as round) from {relation} "
        f"where round in ({MEASURED}, {number}))"
    )
