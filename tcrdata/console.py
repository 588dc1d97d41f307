"""What people see: tables on stdout, messages and progress on stderr, JSON when asked."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

from tcrdata.frame_ranges import spans
from tcrdata.plain_tables import column_widths, goes_into_a_file, plain_table

if TYPE_CHECKING:
    from rich.progress import Progress

    from tcrdata.learning.training import Report
    from tcrdata.outcomes import UnitOutcome

WIDTH_IN_A_FILE = 120


def print_json(value: Any) -> None:
    """Print a value as JSON on stdout; NaN and infinities become null."""
    sys.stdout.write(json.dumps(_finite(value), indent=2, default=str, allow_nan=False) + "\n")


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table on stdout: numbers to the right, None as a dash.

    Names and ids are for pasting: nothing is cut short, and where there is room for them in one
    line only what has spaces is wrapped.
    """
    shown = [[_shown(value) for value in row] for row in rows]
    numeric = [
        any(isinstance(row[index], int | float) for row in rows) for index in range(len(columns))
    ]
    plain = plain_table(title, columns, shown, numeric, WIDTH_IN_A_FILE)
    if plain is not None and goes_into_a_file(sys.stdout):
        sys.stdout.write(plain)
    else:
        _print_rich_table(title, columns, shown, numeric)


def _print_rich_table(
    title: str, columns: Sequence[str], shown: Sequence[Sequence[str]], numeric: Sequence[bool]
) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title or None, title_justify="left", header_style="bold")
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH_IN_A_FILE)
    widths = column_widths(columns, shown, console.width)
    for index, name in enumerate(columns):
        justify: Literal["left", "right"] = "right" if numeric[index] else "left"
        table.add_column(name, justify=justify, width=widths[index], overflow="fold")
    for cells in shown:
        table.add_row(*cells)
    console.print(table)


def say(message: str) -> None:
    """Print a message on stderr."""
    sys.stderr.write(message + "\n")


def failure(outcome: UnitOutcome) -> str:
    """Return the line that says where a unit failed and why."""
    return f"failed: {_place(outcome)}: {outcome.error}"


class BuildBar:
    """A bar of units, and below it one of the steps of the training that runs."""

    def __init__(self, bar: Progress, total: int) -> None:
        self._bar = bar
        self._units = bar.add_task("build", total=total)
        self._steps = bar.add_task("train", total=None, visible=False)

    def advance(self, outcome: UnitOutcome) -> None:
        """Count a unit, and print what went wrong with it."""
        description = f"{outcome.unit.sequence} {outcome.unit.stage}"
        self._bar.update(self._units, advance=1, description=description)
        self._bar.update(self._steps, visible=False)
        if outcome.state == "failed":
            self._bar.console.print(failure(outcome), soft_wrap=True, markup=False)
        if outcome.state == "made":
            for frames, message in spans(outcome.frame_errors):
                name = "frames" if "-" in frames else "frame"
                line = f"left out: {_place(outcome)}, {name} {frames}: {message}"
                self._bar.console.print(line, soft_wrap=True, markup=False)

    def trained(self, labels_round: int, kind: str, report: Report) -> None:
        """Show how far a training is."""
        said = (
            f"{kind} of round {labels_round}: loss {report.loss:.3f}, "
            f"{report.frames_per_s:.1f} frames/s"
        )
        self._bar.update(
            self._steps, visible=True, completed=report.step, total=report.steps, description=said
        )


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Bars with counts, time gone and time left on stderr; silent when that is no terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    # A notebook asks rich for colours; what it shows is no terminal all the same.
    quiet = not sys.stderr.isatty()
    with Progress(*columns, console=Console(stderr=True), disable=quiet) as bars:
        yield bars


def follow(what: str, steps: int, work: Iterable[None]) -> None:
    """Do work step by step under a bar on stderr."""
    with progress_bars() as bars:
        task = bars.add_task(what, total=steps)
        for _ in work:
            bars.advance(task)


@contextmanager
def build_progress(total: int) -> Iterator[BuildBar]:
    """Show a bar of units on stderr while a build runs; only failures when not a terminal."""
    with progress_bars() as bars:
        yield BuildBar(bars, total)


def _place(outcome: UnitOutcome) -> str:
    return f"{outcome.unit.dataset}/{outcome.unit.sequence} {outcome.unit.stage}"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if value == value and abs(value) != float("inf") else None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return str(value)
