"""What a rule says of a proposal, as a sentence: "cycle error 0.31 m, needs <= 0.25 m"."""

from __future__ import annotations

import math
import re

from tcrdata.rules import RuleText

_COMPARISON = re.compile(r"\bvalue (<=|>=|<|>|=)|(<=|<) value (<=|<)")
_UNITLESS = ("share", "ratio", "chi-square")


def unit_of(rule: RuleText | None) -> str:
    """Return the unit of a rule's value: that of the first parameter its `needs:` names."""
    if rule is None:
        return ""
    words = re.findall(r"\w+", rule.needs)
    units = {parameter.name: parameter.unit for parameter in rule.parameters}
    unit = next((units[word] for word in words if word in units), "")
    return "" if unit in _UNITLESS else unit


def need(rule: RuleText | None, value: float | None, bound: float | None, verdict: str) -> str:
    """Return what a rule asks of the value, such as `<= 0.25 m`.

    Args:
        rule: None when its file is not known; then the bound alone is told.
        value: what was measured; of a rule with two bounds it tells which one counts.
        bound: what it was compared with; None for a rule that compares no numbers.
        verdict: passed, failed or abstained.
    """
    if rule is None:
        return "-" if bound is None else f"bound {number(bound)}"
    if bound is None:
        return rule.needs
    if math.isinf(bound):
        return rule.needs.partition("; ")[2] or rule.needs
    sense = _sense(rule, value, bound, verdict)
    if sense is None:
        return rule.needs
    unit = unit_of(rule)
    return f"{sense} {number(bound)}{' ' * bool(unit)}{unit}"


def sentence(
    name: str, rule: RuleText | None, value: float | None, bound: float | None, verdict: str
) -> str:
    """Return one rule's verdict as a sentence; the arguments are those of `need`, and its name."""
    title = name.replace("_", " ")
    needs = need(rule, value, bound, verdict)
    if bound is None:
        return f"{title} {verdict}, needs: {needs}"
    joined = "; " if math.isinf(bound) else ", needs "
    unit = unit_of(rule)
    measured = "not measured" if value is None else f"{number(value)}{' ' * bool(unit)}{unit}"
    abstained = " (abstained)" * (verdict == "abstained")
    return f"{title} {measured}{joined}{needs}{abstained}"


def number(value: float) -> str:
    """Return a number with the digits that matter."""
    return f"{value:.4g}"


def _sense(rule: RuleText, value: float | None, bound: float, verdict: str) -> str | None:
    """The comparison that the rule makes with this bound; None when that cannot be told."""
    found = _COMPARISON.search(rule.needs)
    if found is None:
        return None
    single, lower, upper = found.groups()
    if single:
        holds = verdict == "failed" and value is not None and _compares(value, single, bound)
        return None if holds else str(single)
    if value is None or verdict == "abstained":
        return None
    # Of two bounds one is told: a value on its inner side passes.
    is_lower = (value >= bound) == (verdict == "passed")
    return {"<=": ">=", "<": ">"}[lower] if is_lower else str(upper)


def _compares(value: float, sense: str, bound: float) -> bool:
    """Whether a comparison holds."""
    return {
        "<=": value <= bound,
        ">=": value >= bound,
        "<": value < bound,
        ">": value > bound,
        "=": value == bound,
    }[sense]
