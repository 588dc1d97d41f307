"""`tcrdata funnel`: how the rules of a selection narrow the proposals down."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.resources import resource_files

if TYPE_CHECKING:
    from tcrdata.inspection.funnel import Funnel

_RULES = ("judged", "passed", "failed", "abstained", "alone", "near", "left_over")
_MODULES = ("both_speak", "both_sure", "only_module_sure", "only_other_sure", "none_sure")
_SELECTIONS = ("in_both", "only_selection", "only_other", "ignored_by_other")


def funnel(*, store: StoreUrl, selection: str | None = None, json: Flag = False) -> int:
    """Count what each rule of a selection passes, fails and alone keeps out.

    `alone` are kept out by this rule and no other: what comes in without it. `near` of these miss
    the bound by at most a tenth of it: what a slightly looser bound brings. `left` pass this rule
    and those before it. A margin is the distance to the bound as a share of it, negative where
    the rule fails.

    Args:
        store: folder or URL of the store.
        selection: name or id; the newest when left out.
        json: print as JSON.
    """
    from tcrdata.inspection.funnel import funnel as find
    from tcrdata.store import open_store

    opened = open_store(store)
    found = find(opened, selected(opened, selection))
    if json:
        console.print_json(found.to_json())
    else:
        _print_rules(found)
        _print_agreement(found)
    console.say(_advice(found))
    return 0


def _advice(found: Funnel) -> str:
    """The rule that alone keeps out the most, and how to see what it can be set to."""
    preset = found.selection["preset"]
    if preset not in {path.stem for path in resource_files("queries/presets/*.sql")}:
        preset = f"FOLDER/{preset}.sql"  # of whoever made it
    most = max(found.rules, key=lambda row: int(row["alone"]), default=None)
    if not most or not most["alone"]:
        return f"next: tcrdata rules --preset {preset}"
    return (
        f"rule {most['rule']} alone keeps out {most['alone']:,}, {most['near']:,} of them near its "
        f"bound; its parameters:\nnext: tcrdata rules --preset {preset}"
    )


def _print_rules(found: Funnel) -> None:
    """The funnel itself, then how far its rules overlap."""
    chosen = found.selection
    sys.stdout.write(
        f"selection {chosen['selection_id']} '{chosen['name']}' of preset {chosen['preset']}: "
        f"{chosen['labels']:,} labels from {chosen['proposals_judged']:,} proposals\n"
    )
    rows = [
        (
            row["rule"] + " *" * row["required"],
            *(row[name] for name in _RULES),
            row["margin_p10"],
            row["margin_p50"],
        )
        for row in found.rules
    ]
    heads = ("rule", *_RULES[:-1], "left", "margin p10", "p50")
    console.print_table("rules, in order", heads, rows)
    if any(row["required"] for row in found.rules):
        sys.stdout.write("* required: where it abstains it keeps out too\n")
    failing = [row for row in found.rules if row["failed"]]
    if failing:
        console.print_table(
            "of what a rule fails, the % that the others fail too",
            ("rule", *(str(row["place"]) for row in failing)),
            [
                (f"{row['place']} {row['rule']}", *(_share(row, other) for other in failing))
                for row in failing
            ],
        )


def _share(row: dict[str, Any], other: dict[str, Any]) -> str:
    """Percent of a rule's failures that another one fails too."""
    share = row["fails_too"].get(other["rule"])
    return "" if share is None else f"{100 * share:.0f}"


def _print_agreement(found: Funnel) -> None:
    """What modules cover and how they agree; how selections do."""
    if found.modules:
        pairs = (*_MODULES, "agreement", "lift")
        console.print_table(
            "modules, and pairs of modules that speak of the same proposals",
            ("module", "asked", *(name.replace("_", " ") for name in pairs)),
            [
                (
                    f"{row['module']} & {row['other']}" if row["other"] else row["module"],
                    row["asked"],
                    *(row[name] for name in pairs),
                )
                for row in found.modules
            ],
        )
    if found.selections:
        others = (*_SELECTIONS, "shared")
        console.print_table(
            "agreement with other selections",
            ("other", *(name.replace("_", " ") for name in others)),
            [
                (f"{row['other']} {row['other_id'][:8]}", *(row[name] for name in others))
                for row in found.selections
            ],
        )
