"""How a selection's rules narrow the proposals down, and how modules and selections agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tcrdata.inspection.selected_views import connect_selections, selection_rows
from tcrdata.reports import report_rows

if TYPE_CHECKING:
    from tcrdata.store import Store


@dataclass(frozen=True)
class Funnel:
    """What the reports `funnel` and `agreement_*` give for a selection, as rows.

    Attributes:
        selection: its row of `selections`.
        rules: a row a rule, in order.
        modules: a row a module, then a row a pair of modules that speak of the same proposals.
        selections: a row a selection beside this one.
    """

    selection: dict[str, Any]
    rules: list[dict[str, Any]]
    modules: list[dict[str, Any]]
    selections: list[dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """The funnel without the texts of the rules."""
        shown = ("selection_id", "name", "preset", "round", "snapshot", "labels", "ignored")
        return {
            **{name: self.selection[name] for name in shown},
            "rules": self.rules,
            "modules": self.modules,
            "selections": self.selections,
        }


def funnel(store: Store, selection_id: str) -> Funnel:
    """Judge every proposal that a selection saw by each of its rules and count.

    Args:
        store: that holds it.
        selection_id: the selection.

    Raises:
        StoreError: the selection's snapshot is gone, or one of its files is damaged.
    """
    (selection,) = selection_rows(store, selection_id)
    connection = connect_selections(store, [selection])
    one = {"selection_id": selection_id}
    return Funnel(
        selection,
        report_rows(connection, "funnel", one),
        report_rows(connection, "agreement_modules"),
        report_rows(connection, "agreement_selections", one),
    )
