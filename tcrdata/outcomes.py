"""What became of each unit of work of a build."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from tcrdata.store import Unit

if TYPE_CHECKING:
    from tcrdata.rules import Selection

State = Literal["done", "made", "failed", "skipped", "todo"]


@dataclass(frozen=True)
class UnitOutcome:
    """What became of one unit of work.

    Attributes:
        unit: the unit.
        state: `done` before, `made` now, `failed`, `skipped` (something it needs failed) or
            `todo` (in a dry run).
        error: why it failed.
        frame_errors: (frame, message) of frames left out.
        seconds: wall time it took; for reports alone, never for the store.
    """

    unit: Unit
    state: State
    error: str | None = None
    frame_errors: tuple[tuple[int, str], ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class BuildReport:
    """What a build did: one outcome a unit, and the selections it ended with."""

    outcomes: tuple[UnitOutcome, ...]
    selections: tuple[Selection, ...] = field(default=())

    @property
    def leading(self) -> tuple[Selection, ...]:
        """The first selection of each round: the one whose labels the next round learns from."""
        rounds: dict[int, Selection] = {}
        for selection in self.selections:
            rounds.setdefault(selection.round, selection)
        return tuple(rounds[number] for number in sorted(rounds))

    def count(self, state: State) -> int:
        """Number of units with a state."""
        return sum(outcome.state == state for outcome in self.outcomes)
