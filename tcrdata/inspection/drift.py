"""What each round of the EM loop made of the labels of the round before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from tcrdata.inspection.diff import diff
from tcrdata.reports import report_rows

if TYPE_CHECKING:
    from tcrdata.store import Store

GONE = ("lost", "to_ignore")
COME = ("gained", "to_positive")


@dataclass(frozen=True)
class Drift:
    """One round against the one before.

    Attributes:
        round: the later one.
        labels: its positive labels.
        kept: labels that both have, in the same box.
        moved: labels that both have, in another box.
        gained: labels that came, those undecided before included.
        lost: labels that went, those undecided now included.
        agreement_before: share of the former labels that a detector is sure of; None without one.
        agreement: share of the labels that the round's detector is sure of.
        worse: why the round is worth a look; None when nothing speaks against it.
    """

    round: int
    labels: int
    kept: int
    moved: int
    gained: int
    lost: int
    agreement_before: float | None
    agreement: float | None
    worse: str | None

    def to_json(self) -> dict[str, Any]:
        """The drift as plain values."""
        return asdict(self)


def drift_between(store: Store, selection_a: str, selection_b: str) -> Drift:
    """Compare the labels of a round with those of the round before.

    Args:
        store: that holds both.
        selection_a: id of the selection of the round before.
        selection_b: id of the selection of the round.

    Raises:
        SettingsError: both are the same selection.
        StoreError: a selection's snapshot is gone, or one of its files is damaged.
    """
    found = diff(store, selection_a, selection_b)
    changes = {row["change"]: row["labels"] for row in found.changes}
    lost = sum(changes.get(name, 0) for name in GONE)
    connection = store.connect(tables=("labels", "selections", "confidences"))
    parameters = {"selection_a": selection_a, "selection_b": selection_b, "lost": lost}
    (row,) = report_rows(connection, "drift", parameters)
    return Drift(
        round=row["round_b"],
        labels=row["labels_b"],
        kept=changes.get("kept", 0),
        moved=changes.get("moved", 0),
        gained=sum(changes.get(name, 0) for name in COME),
        lost=lost,
        agreement_before=row["agreement_a"],
        agreement=row["agreement_b"],
        worse=row["worse"],
    )


def drifts(store: Store, selections: Sequence[str]) -> list[Drift]:
    """Compare each round's selection with the one before.

    Args:
        store: that holds them.
        selections: their ids, one a round, in order.
    """
    return [drift_between(store, before, after) for before, after in pairwise(selections)]
