"""`tcrdata rules`: what the rules decide."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from typing import TYPE_CHECKING

from tcrdata import console
from tcrdata.cli.app import Flag

if TYPE_CHECKING:
    from tcrdata.inspection.rule_catalogue import Catalogue


def rules(*, preset: str | None = None, json: Flag = False) -> int:
    """Say what each rule decides, its parameters, units, and where in the paper it comes from.

    Args:
        preset: only the rules of this preset, in its order and with its values: a name, or the
            path of your own; every rule that ships when left out.
        json: print as JSON.
    """
    from tcrdata.inspection.rule_catalogue import catalogue

    found = catalogue(preset)
    if json:
        console.print_json(dataclasses.asdict(found))
    else:
        _print(found)
    known = f" --preset {shlex.quote(preset)}" if preset else ""
    console.say(f"next: tcrdata check --store STORE{known} --set PARAMETER=VALUE --name NAME")
    return 0


def _print(found: Catalogue) -> None:
    """The rules, then what they can be set to."""
    if found.preset:
        sys.stdout.write(f"{found.preset}: {found.takes}\n")
    console.print_table(
        "rules",
        ("rule", "decides", "needs", "source", "cues"),
        [
            (r.rule + " *" * bool(r.required), r.decides, r.needs, r.source, ", ".join(r.cues))
            for r in found.rules
        ],
    )
    if any(rule.required for rule in found.rules):
        sys.stdout.write("* required: where it has no evidence and abstains, the proposal fails\n")
    entries = [(rule.rule, rule.parameters) for rule in found.rules]
    entries += [(f"select of {found.preset}", found.own)] * bool(found.own)
    values = ("default", "preset's") if found.preset else ("default",)
    console.print_table(
        "parameters",
        ("parameter", *values, "unit", "meaning", "rule"),
        [
            (p.name, *(p.default, p.value)[: len(values)], p.unit, p.meaning, rule)
            for rule, parameters in entries
            for p in parameters
        ],
    )
