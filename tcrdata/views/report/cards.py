"""Cards of the gallery: pictures of a candidate, what decided about it, and the id to ask about."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tcrdata.views.report.html import counted, measure, number, tag, text

Row = Mapping[str, Any]
BOX_KINDS = {"accepted": "labels", "barely": "labels", "nearly": "ignored", "rejected": "rejected"}
_SOURCES_SHOWN = {"free_space": "free space"}


@dataclass(frozen=True)
class RuleWords:
    """How a rule is spoken of.

    Attributes:
        unit: of its value and bound; empty without one.
        needs: its condition, for rules that compare no numbers.
    """

    unit: str = ""
    needs: str = ""


@dataclass(frozen=True)
class Card:
    """One candidate.

    Attributes:
        row: of `report_gallery`.
        verdicts: of `report_gallery_checks`, in the preset's order.
        camera: HTML of the cut-out, or of why there is none; empty when the other picture says so.
        above: HTML of the bird's-eye view, or of why there is none; empty likewise.
        truth: what ground truth says, plain text; empty where nobody labelled.
    """

    row: Row
    verdicts: Sequence[Row]
    camera: str
    above: str
    truth: str


def cards(group: Sequence[Card], words: Mapping[str, RuleWords]) -> str:
    """Return the cards of one kind.

    Args:
        group: in order.
        words: rule to what is said of its numbers.
    """
    return tag("div", *(_card(card, words) for card in group), class_="cards")


def _card(card: Card, words: Mapping[str, RuleWords]) -> str:
    both = card.camera and card.above
    views = tag("div", card.camera, card.above, class_="views" if both else "views single")
    told = tag(
        "div",
        tag("p", why(card.row, card.verdicts, words), class_="why"),
        _strip(card.verdicts, words),
        tag("p", _meta(card), class_="meta"),
        _id(card.row["proposal_id"]),
        class_="told",
    )
    return tag("article", views, told, class_="card")


def why(row: Row, verdicts: Sequence[Row], words: Mapping[str, RuleWords]) -> str:
    """Return the sentence that says what decided, as HTML."""
    by_rule = {verdict["rule"]: verdict for verdict in verdicts}
    verdict = by_rule.get(row["deciding_rule"])
    if verdict is None:
        if row["kind"] == "rejected":
            return "Passes every rule; the preset's own select leaves it out."
        if row["state"] == "ignore":
            return f"Ignored: passes every rule here, and {_undecided(row)}."
        return f"Accepted, score {number(row['score'])}; no rule of it compares numbers."
    numbers = text(_numbers(verdict, words.get(verdict["rule"], RuleWords())))
    rule = tag("b", text(verdict["rule"]))
    if not verdict["fails"]:
        return f"Accepted, score {number(row['score'])}. Closest call: {rule}, {numbers}."
    what = "no evidence, which this preset requires" if verdict["passed"] is None else numbers
    more = verdict["failures"] - 1
    others = f", and {counted(more, 'more rule')}" if more else " alone"
    if row["state"] == "ignore":
        return f"Ignored, since {_undecided(row)}. Fails {rule}{others}: {what}."
    return f"Fails {rule}{others}: {what}."


def _undecided(row: Row) -> str:
    """Why a selection neither takes nor rejects a candidate, as HTML."""
    because = row["ignored_because"]
    if because is None:
        return "the preset leaves it undecided"
    return "looser bounds accept it" if because == "loosened" else f"{text(because)} accepts it"


def _numbers(verdict: Row, words: RuleWords) -> str:
    """Value and bound, or the condition of a rule that compares no numbers; plain text."""
    value, bound = verdict["value"], verdict["bound"]
    if value is None or bound is None:
        return f"needs {words.needs}" if words.needs else "a rule without numbers"
    if math.isinf(bound):
        return f"{measure(value, words.unit)}; no value would do"
    return f"{measure(value, words.unit)}, bound {measure(bound, words.unit)}"


def _strip(verdicts: Sequence[Row], words: Mapping[str, RuleWords]) -> str:
    """A mark a rule, in the preset's order."""
    marks = []
    for verdict in verdicts:
        if verdict["fails"]:
            kind, said = "f", "fails"
        elif verdict["passed"]:
            kind, said = "p", "passes"
        else:
            kind, said = "a", "abstains"
        numbers = _numbers(verdict, words.get(verdict["rule"], RuleWords()))
        tip = f"{verdict['rule']} {said}" + (f": {numbers}" if kind != "a" else "")
        marks.append(tag("i", class_=kind, title=tip))
    return tag("div", *marks, class_="strip", role="img", aria_label=_summary(verdicts))


def _summary(verdicts: Sequence[Row]) -> str:
    failed = [verdict["rule"] for verdict in verdicts if verdict["fails"]]
    return f"{len(verdicts)} rules, failed: {', '.join(failed) or 'none'}"


def _meta(card: Card) -> str:
    row = card.row
    size = " × ".join(number(row[name]) for name in ("length_m", "width_m", "height_m"))
    source = _SOURCES_SHOWN.get(row["source"], row["source"])
    parts = [
        f"{source}, {row['found']}",
        f"{measure(row['range_m'], 'm')} away",
        f"{size} m",
        counted(row["number_of_points"], "point"),
    ]
    if row["speed_mps"] is not None:
        parts.append(measure(row["speed_mps"], "m/s"))
    lines = text(" · ".join(parts))
    return lines + (f"<br>{text(card.truth)}" if card.truth else "")


def _id(proposal_id: str) -> str:
    return tag(
        "div",
        tag("code", text(proposal_id)),
        tag("button", "copy", type="button", data_copy=proposal_id),
        class_="id",
    )
