"""What became of one selection's labels in another, and which rule or parameter made it so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tcrdata.errors import SettingsError
from tcrdata.inspection.selected_views import connect_selections, selection_rows
from tcrdata.reports import report_rows

if TYPE_CHECKING:
    from tcrdata.store import Store

# What is a label of the same state in both needs no verdict.
_CHANGED = (
    "select proposal_id from labels where selection_id in ('{}', '{}') "
    "group by proposal_id having count(*) = 1 or min(state) <> max(state)"
)

_MOVES = ("centre_m", "turn_rad", "size_m")
_SHOWN = {
    "all": ("change", "labels", "examples", *_MOVES),
    "sequence": ("dataset", "sequence", "change", "labels", *_MOVES),
    "rules": ("change", "rules", "evidence", "labels", "examples"),
}


@dataclass(frozen=True)
class Difference:
    """What the reports `diff` and `diff_rules` give for two selections, as rows.

    Attributes:
        selection_a: row of `selections` to start from.
        selection_b: row of `selections` compared with it.
        rules: a row a rule of either: what changed in it.
        changes: a row a change, over all sequences.
        sequences: the same, a row a change and sequence.
        causes: a row a change and the rules whose verdict flipped, with `because`, what changed
            in each of them.
    """

    selection_a: dict[str, Any]
    selection_b: dict[str, Any]
    rules: list[dict[str, Any]]
    changes: list[dict[str, Any]]
    sequences: list[dict[str, Any]]
    causes: list[dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """The difference; texts only of rules that were edited."""
        shown = ("selection_id", "name", "preset", "round", "snapshot", "labels", "ignored")
        texts = ("text_a", "text_b")
        return {
            "a": {name: self.selection_a[name] for name in shown},
            "b": {name: self.selection_b[name] for name in shown},
            "rules": [
                {k: v for k, v in row.items() if k not in texts or row["change"] == "text"}
                for row in self.rules
                if row["change"] != "same"
            ],
            "changes": self.changes,
            "causes": self.causes,
            "sequences": self.sequences,
        }


def diff(store: Store, selection_a: str, selection_b: str) -> Difference:
    """Compare two selections of a store.

    Args:
        store: that holds both.
        selection_a: id to start from.
        selection_b: id to compare with it.

    Raises:
        SettingsError: both are the same selection.
        StoreError: a selection's snapshot is gone, or one of its files is damaged.
    """
    if selection_a == selection_b:
        raise SettingsError(
            f"A and B are the same selection {selection_a}: compare it with another one; "
            "`tcrdata check --set PARAMETER=VALUE --name NAME` makes one"
        )
    rows = selection_rows(store, selection_a, selection_b)
    connection = connect_selections(store, rows, _CHANGED.format(selection_a, selection_b))
    both = {"selection_a": selection_a, "selection_b": selection_b}
    rules = report_rows(connection, "diff_rules", both)
    counts = report_rows(connection, "diff", both)
    levels = {
        level: [
            {k: v for k, v in row.items() if k in columns}
            for row in counts
            if row["level"] == level
        ]
        for level, columns in _SHOWN.items()
    }
    explained = {row["rule"]: _explanation(row) for row in rules}
    causes = [{**row, "because": _because(row, explained)} for row in levels["rules"]]
    return Difference(rows[0], rows[1], rules, levels["all"], levels["sequence"], causes)


def _because(row: dict[str, Any], explained: dict[str, str]) -> list[str]:
    """What changed in the rules of a cause, in words."""
    if row["evidence"] != "both":
        return [f"measured {row['evidence']}"]
    return [explained[rule] for rule in row["rules"] or ("select of the preset",)]


def _explanation(rule: dict[str, Any]) -> str:
    """What changed in a rule, in words."""
    if rule["change"] == "parameters":
        return ", ".join(f"{p['name']} {p['a']} -> {p['b']}" for p in rule["parameters"])
    return {
        "same": "other evidence under the same rule",
        "text": "rule text changed",
        "required": "whether it is required changed",
    }.get(rule["change"], f"rule {rule['change']}")
