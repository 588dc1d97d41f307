"""Tables as text: to the letter as rich draws them, or left to it."""

from __future__ import annotations

import random

import pytest

from tcrdata import console
from tcrdata.plain_tables import plain_table

WORDS = ["a", "bb", "source/fit", ">= 0.5", "abstained", "section 3.7 cuts,", "1,234", "", "x"]


def _drawn(
    title: str, names: list[str], rows: list[list[str]], right: list[bool]
) -> tuple[str | None, str]:
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("sys.stdout.write", lines.append)
        console._print_rich_table(title, names, rows, right)
        return plain_table(title, names, rows, right, console.WIDTH_IN_A_FILE), "".join(lines)


@pytest.mark.parametrize("seed", range(12))
def test_a_table_is_as_rich_draws_it(seed: int) -> None:
    chance = random.Random(seed)
    count = chance.randint(2, 6)
    cells = [" ".join(chance.choices(WORDS, k=chance.randint(1, 9))).strip() for _ in range(60)]
    rows = [cells[i * count : (i + 1) * count] for i in range(4)]
    names = [f"name of {letter}" for letter in "abcdef"[:count]]
    right = [chance.random() < 0.5 for _ in range(count)]
    title = chance.choice(["", "units"])
    plain, rich = _drawn(title, names, rows, right)
    assert plain == rich


@pytest.mark.parametrize("cell", ["[bold]x[/bold]", ":car:", "wide 漢", "  indented", "w" * 130])
def test_what_takes_rich_is_left_to_it(cell: str) -> None:
    assert plain_table("", ["a"], [[cell]], [False], console.WIDTH_IN_A_FILE) is None
