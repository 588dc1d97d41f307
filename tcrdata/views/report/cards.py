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


def cards(group: Sequence[Card], units: Mapping[str, str]) -> str:
    """Return the cards of one kind.

    Args:
        group: in order.
        units: rule to the unit of its value.
    """
    return tag("div", *(_card(card, units) for card in group), class_="cards")


def _card(card: Card, units: Mapping[str, str]) -> str:
    both = card.camera and card.above
    views = tag("div", card.camera, card.above, class_="views" if both else "views single")
    told = tag(
        "div",
        tag("p", why(card.row, card.verdicts, units), class_="why"),
        _strip(card.verdicts, units),
        tag("p", _meta(card), class_="meta"),
        _id(card.row["proposal_id"]),
        class_="told",
    )
    return tag("article", views, told, class_="card")


def why(row: Row, verdicts: Sequence[Row], units: Mapping[str, str]) -> str:
    """Return the sentence that says what decided, as HTML."""
    by_rule = {verdict["rule"]: verdict for verdict in verdicts}
    verdict = by_rule.get(row["deciding_rule"])
    if verdict is None:
        if row["kind"] == "rejected":
            return "Passes every rule; the preset's own select leaves it out."
        if row["state"] == "ignore":
            return "Ignored: passes every rule here, and the selection leaves it undecided."
        return f"Accepted, score {number(row['score'])}; no rule of it compares numbers."
    numbers = _numbers(verdict, units.get(verdict["rule"], ""))
    rule = tag("b", text(verdict["rule"]))
    if not verdict["fails"]:
        return f"Accepted, score {number(row['score'])}. Closest call: {rule}, {numbers}."
    what = "no evidence, which this preset requires" if verdict["passed"] is None else numbers
    more = verdict["failures"] - 1
    others = f", and {counted(more, 'more rule')}" if more else " alone"
    said = "Ignored: fails" if row["state"] == "ignore" else "Fails"
    return f"{said} {rule}{others}: {what}."


def _numbers(verdict: Row, unit: str) -> str:
    value, bound = verdict["value"], verdict["bound"]
    if value is None or bound is None:
        return "a rule without numbers"
    if math.isinf(bound):
        return f"{measure(value, unit)}; no value would do"
    return f"{measure(value, unit)}, bound {measure(bound, unit)}"


def _strip(verdicts: Sequence[Row], units: Mapping[str, str]) -> str:
    """A mark a rule, in the preset's order."""
    marks = []
    for verdict in verdicts:
        if verdict["fails"]:
            kind, said = "f", "fails"
        elif verdict["passed"]:
            kind, said = "p", "passes"
        else:
            kind, said = "a", "abstains"
        numbers = _numbers(verdict, units.get(verdict["rule"], ""))
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
