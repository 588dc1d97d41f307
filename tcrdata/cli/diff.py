"""`tcrdata diff`: what changed from one selection to another."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING, Any

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.errors import MissingEvidenceError

if TYPE_CHECKING:
    from tcrdata.inspection.diff import Difference
    from tcrdata.store import Store

MOST_SEQUENCES = 20
_CHANGES = ("moved", "gained", "lost", "to_ignore", "to_positive")
_STATES = ("kept", *_CHANGES)
_MOVES = ("centre_m", "turn_rad", "size_m")


def diff(a: str, b: str, /, *, store: StoreUrl, json: Flag = False) -> int:
    """Compare the labels of two selections: gained, lost, kept, moved, and by whose doing.

    Args:
        a: name or id of the selection to start from, or the number of a round.
        b: name or id of the one compared with it, or the number of a round.
        store: folder or URL of the store.
        json: print as JSON.
    """
    from tcrdata.inspection.diff import diff as find
    from tcrdata.store import open_store

    opened = open_store(store)
    one, other = _selection(opened, a), _selection(opened, b)
    found = find(opened, one, other)
    if json:
        console.print_json(found.to_json())
    else:
        _print_rules(found)
        _print_changes(found)
        _print_sequences(found)
    called = b if opened.newest_selection(b) == other else other  # the number of a round is no name
    where = f"--store {shlex.quote(store)} --selection {shlex.quote(called)}"
    examples = [example for row in found.causes for example in row["examples"][:1]]
    command = f"why {examples[0]}" if examples else "evaluate"
    console.say(f"next: tcrdata {command} {where}")
    return 0


def _selection(store: Store, name: str) -> str:
    """The id of a selection by name or id, or of the only one of a round."""
    if name.isdigit() and store.newest_selection(name) is None:
        rows = store.read("selections", round=int(name)).to_pylist()
        if len(rows) == 1:
            return str(rows[0]["selection_id"])
        if rows:
            names = ", ".join(sorted({row["name"] for row in rows}))
            raise MissingEvidenceError(
                f"round {name} has {len(rows)} selections: name one of {names}"
            )
    return selected(store, name)


def _print_rules(found: Difference) -> None:
    """Which is which, and what differs in what they demand."""
    for letter, row in (("A", found.selection_a), ("B", found.selection_b)):
        sys.stdout.write(
            f"{letter} {row['selection_id']} '{row['name']}' of preset {row['preset']}: "
            f"{row['labels']:,} labels\n"
        )
    changed = [row for row in found.rules if row["change"] != "same"]
    if changed:
        heads = ("rule", "changed", "parameter", "A", "B")
        console.print_table("rules that differ", heads, [_ for row in changed for _ in _lines(row)])
    else:
        sys.stdout.write("the rules and their parameters are the same\n")


def _lines(rule: dict[str, Any]) -> list[tuple[Any, ...]]:
    """A line a parameter of a rule, at least one."""
    parameters = rule["parameters"] or [{"name": None, "a": None, "b": None}]
    return [(rule["rule"], rule["change"], p["name"], p["a"], p["b"]) for p in parameters]


def _print_changes(found: Difference) -> None:
    """How many labels changed and how far, then by the rules that changed their verdict."""
    rows = [(row["change"].replace("_", " "), row["labels"], *_moves(row)) for row in found.changes]
    heads = (
        "change",
        "labels",
        "centre m, p50",
        "p90",
        "turn rad, p50",
        "p90",
        "size m, p50",
        "p90",
    )
    console.print_table("labels, from A to B", heads, rows)
    if found.causes:
        console.print_table(
            "by the rules whose verdict changed",
            ("for example", "change", "labels", "rules", "because"),
            [
                (
                    row["examples"][0],
                    row["change"].replace("_", " "),
                    row["labels"],
                    ", ".join(row["rules"] or ("select of the preset",)),
                    "; ".join(row["because"]),
                )
                for row in found.causes
            ],
        )


def _moves(row: dict[str, Any]) -> list[float | None]:
    """Median and 90th percentile of what the boxes moved; only of a change that moves boxes."""
    moves = [row[name] if row["change"] == "moved" else None for name in _MOVES]
    return [value for pair in moves for value in (pair or (None, None))]


def _print_sequences(found: Difference) -> None:
    """How many labels changed in each sequence, those with most changes first."""
    counts: dict[str, dict[str, int]] = {}
    for row in found.sequences:
        counts.setdefault(f"{row['dataset']}/{row['sequence']}", {})[row["change"]] = row["labels"]
    order = sorted(counts, key=lambda name: (-sum(counts[name].get(s, 0) for s in _CHANGES), name))
    rows = [(name, *(counts[name].get(state, 0) for state in _STATES)) for name in order]
    heads = ("sequence", *(state.replace("_", " ") for state in _STATES))
    console.print_table("by sequence", heads, rows[:MOST_SEQUENCES])
    if len(rows) > MOST_SEQUENCES:
        console.say(f"{len(rows) - MOST_SEQUENCES:,} more sequences: --json lists them")
