"""`tcrdata test-rules`: the given and expected cases of rules."""

from __future__ import annotations

import math
import shlex
import sys
from typing import Any

from tcrdata import console
from tcrdata.cli.app import Flag


def test_rules(folder: str | None = None, /, *, json: Flag = False) -> int:  # noqa: PT028
    """Run the cases of rules: given rows, expected verdicts. Exits with 1 when one fails.

    A folder has rules/<rule>.sql and cases/<rule>.toml, or both side by side.

    Args:
        folder: of your own rules; those that ship with tcrdata when left out.
        json: print the results as JSON.
    """
    from tcrdata.inspection.rule_cases import run_cases

    results = run_cases(folder)
    failing = results.differences
    if json:
        console.print_json(
            {
                "rules": results.cases,
                "untested": list(results.untested),
                "differences": [vars(difference) for difference in failing],
            }
        )
    else:
        wrong = {(difference.rule, difference.case) for difference in failing}
        counts = {rule: sum(name == rule for name, _ in wrong) for rule in results.cases}
        rows = [(rule, count - counts[rule], counts[rule]) for rule, count in results.cases.items()]
        console.print_table("rules", ("rule", "cases that hold", "cases that fail"), rows)
        for d in failing:
            sys.stdout.write(
                f"{d.rule}, case '{d.case}', proposal {d.proposal}: {d.what} is {_shown(d.found)}, "
                f"expected {_shown(d.expected)}\n"
            )
    for rule in results.untested:
        console.say(f"rule {rule} has no case: write {rule}.toml beside the other cases")
    own = shlex.quote(folder or "")
    if failing:
        where = f" {own}" if folder else ""
        console.say(f"next: correct the rule or its case, then tcrdata test-rules{where}")
    elif folder and not results.untested:
        console.say(f"next: tcrdata check --store STORE --preset {own}/PRESET.sql")
    elif not results.untested:
        console.say("next: tcrdata rules")
    return 1 if failing else 0


def _shown(value: Any) -> str:
    """A value of a verdict as the case file spells it."""
    if value is None:
        return "left out (NULL)"
    if isinstance(value, bool):
        return "true" if value else "false"
    return "inf" if value == math.inf else repr(value)
