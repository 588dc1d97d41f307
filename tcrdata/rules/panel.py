"""The rules of several presets side by side: one text is judged once, whoever lists it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tcrdata.rules.presets import FilledPreset, FilledRule
from tcrdata.rules.scopes import frame_keys, handing_on


@dataclass(frozen=True)
class Seat:
    """A rule and the presets that listen to it; presets are bits of a mask.

    Attributes:
        number: bit of the rule among the verdicts that a proposal carries.
        rule: judged once.
        listening: presets that list the rule.
        strict: presets that an abstaining rule fails a proposal for.
    """

    number: int
    rule: FilledRule
    listening: int
    strict: int

    @property
    def streams(self) -> bool:
        """Whether a proposal's row goes in and comes out, so that there is nothing to check."""
        reads = self.rule.reads
        return reads.row_by_row and (reads.passes_id or self.hands_on)

    @property
    def hands_on(self) -> bool:
        """Whether its text can be made to give a proposal's whole row in the place of the id."""
        rule = self.rule
        return rule.reads.starts_with_id and handing_on(rule.select, "") is not None

    @property
    def of_frames(self) -> bool:
        """Whether it looks at nothing but a proposal's frame, and joins."""
        return bool(frame_keys(self.rule.select, self.rule.reads))

    @property
    def joins(self) -> bool:
        """Whether it reads other tables than `proposals`."""
        return self.rule.reads.tables != ("proposals",)

    def failed(self, passed: str) -> str:
        """SQL of the presets that a verdict fails a proposal for."""
        return (
            f"case when {passed} then 0 when {passed} is null then {self.strict} "
            f"else {self.listening} end"
        )


def seats(presets: Sequence[FilledPreset]) -> list[Seat]:
    """Each rule text of some presets once: those that go row by row first, then earliest place.

    Of those that go row by row the ones that join come last.

    Rules say the same of a proposal whichever others judged it before, and joins see fewer rows.

    Args:
        presets: bit k of the masks stands for the k-th.
    """
    found: dict[str, list[tuple[int, FilledRule]]] = {}
    places: dict[str, int] = {}
    for bit, preset in enumerate(presets):
        for place, rule in enumerate(preset.rules):
            found.setdefault(rule.select, []).append((bit, rule))
            places[rule.select] = min(place, places.get(rule.select, place))
    earliest = [
        Seat(
            number,
            found[text][0][1],
            sum(1 << bit for bit, _ in found[text]),
            sum(1 << bit for bit, rule in found[text] if rule.required),
        )
        for number, text in enumerate(sorted(found, key=lambda text: places[text]))
    ]
    return sorted(earliest, key=lambda seat: (not seat.streams, seat.streams and seat.joins))


def runs(panel: Sequence[Seat]) -> list[list[Seat]]:
    """Rules in order; neighbours that go row by row, or judge frames, are run in one statement."""
    found: list[list[Seat]] = []
    for seat in panel:
        before = found[-1][-1] if found else None
        alike = before is not None and (
            (before.streams and seat.streams) or (before.of_frames and seat.of_frames)
        )
        if alike:
            found[-1].append(seat)
        else:
            found.append([seat])
    return found
