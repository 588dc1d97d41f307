"""Tables as text, as rich draws them, where nobody sees colours: in a third of a command's wait."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import TextIO

_COLOURS = ("FORCE_COLOR", "TTY_COMPATIBLE", "JUPYTER_COLUMNS")
# Of what rich reads as markup or an emoji, of wide letters and of indents it knows more.
_RICHER = re.compile(r"^ |[^ -~]|\[|\\\\|:[^ :]+:")
_WORD = re.compile(r"\s*\S+\s*")


def goes_into_a_file(stream: TextIO) -> bool:
    """Whether a stream is a file or a pipe that takes the characters of frames."""
    coloured = any(os.environ.get(name) for name in _COLOURS) or "ipykernel" in sys.modules
    utf8 = (stream.encoding or "").lower().startswith("utf")
    return utf8 and not coloured and not stream.isatty()


def column_widths(
    columns: Sequence[str], rows: Sequence[Sequence[str]], width: int
) -> list[int | None]:
    """Return characters for each column that leave every word whole; None where none fit.

    Args:
        columns: their names.
        rows: cells, as many as columns.
        width: of the whole table, frames counted in.
    """
    cells_of = [[name, *(row[index] for row in rows)] for index, name in enumerate(columns)]
    longest = [max(len(word) for cell in cells for word in cell.split(" ")) for cells in cells_of]
    wanted = [max(map(len, cells)) for cells in cells_of]
    room = width - 3 * len(columns) - 1 - sum(longest)
    if room < 0:
        return [None] * len(columns)
    widths: list[int | None] = [None] * len(columns)
    # Who needs little more gets it first; what is left goes to the long ones.
    for index in sorted(range(len(columns)), key=lambda i: wanted[i] - longest[i]):
        more = min(wanted[index] - longest[index], room)
        widths[index] = longest[index] + more
        room -= more
    return widths


def plain_table(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    to_the_right: Sequence[bool],
    width: int,
) -> str | None:
    """Return a table as text; None where it takes rich to draw it.

    Args:
        title: above it; none when empty.
        columns: their names.
        rows: cells, as many as columns.
        to_the_right: which columns are.
        width: most characters of a line.
    """
    widths = [number or 0 for number in column_widths(columns, rows, width)]
    whole = sum(widths) + 3 * len(widths) + 1
    texts = [title, *columns, *(cell for row in rows for cell in row)]
    if not all(widths) or len(title) > whole or any(map(_RICHER.search, texts)):
        return None
    ruled = [number + 2 for number in widths]
    lines = [title.ljust(whole)] if title else []
    lines.append("┏" + "┳".join("━" * number for number in ruled) + "┓")
    lines += _lines(columns, widths, to_the_right, "┃", at_the_bottom=True)
    lines.append("┡" + "╇".join("━" * number for number in ruled) + "┩")
    for row in rows:
        lines += _lines(row, widths, to_the_right, "│")
    lines.append("└" + "┴".join("─" * number for number in ruled) + "┘")
    return "\n".join(lines) + "\n"


def _lines(
    cells: Sequence[str],
    widths: Sequence[int],
    to_the_right: Sequence[bool],
    frame: str,
    *,
    at_the_bottom: bool = False,
) -> Iterator[str]:
    """Yield the lines of a row whose cells are wrapped between words."""
    parts = [_wrapped(cell, width) for cell, width in zip(cells, widths, strict=True)]
    height = max(map(len, parts))
    if at_the_bottom:
        parts = [[""] * (height - len(part)) + part for part in parts]
    for line in zip_longest(*parts, fillvalue=""):
        padded = [
            text.rstrip().rjust(width) if right else text[:width].ljust(width)
            for text, width, right in zip(line, widths, to_the_right, strict=True)
        ]
        yield f"{frame} " + f" {frame} ".join(padded) + f" {frame}"


def _wrapped(text: str, width: int) -> list[str]:
    """Return a text in lines; each word, none of which is longer than that, has its spaces."""
    lines: list[str] = []
    line = ""
    for word in _WORD.findall(text):
        if line and len(line) + len(word.rstrip()) > width:
            lines.append(line)
            line = ""
        line += word
    return [*lines, line]
