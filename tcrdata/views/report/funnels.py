"""What each rule does to the candidates: a stacked bar a rule, and how far rules overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tcrdata.views.report.html import NOTHING, count, details, number, percent, tag, text

Row = Mapping[str, Any]
_PARTS = {
    "pass": "passes",
    "abstain": "abstains",
    "fail": "fails, as others do",
    "alone": "keeps out alone",
}
_WIDTH = 1000.0


def funnel_table(rows: Sequence[Row], decides: Mapping[str, str]) -> str:
    """Return a row a rule, in order, with its bar.

    Args:
        rows: of the report `funnel`.
        decides: rule to what it decides, plain text.
    """
    head = ("rule", "verdicts", "left", "fails", "alone", "near", "margin")
    kinds = (None, None, "n", "n", "n", "n", "n")
    tips = (
        None,
        None,
        "candidates that this rule and those before it let through",
        "candidates that it fails",
        "candidates that it alone keeps out: they come in without it",
        "of these, candidates that miss its bound by a tenth of it or less",
        "distance to the bound as a share of it, negative where it fails: 10th and 50th percentile",
    )
    top = "".join(
        tag("th", cell, scope="col", class_=kind, title=tip)
        for cell, kind, tip in zip(head, kinds, tips, strict=True)
    )
    body = "".join(_row(row, decides) for row in rows)
    return legend() + tag(
        "div",
        tag("table", tag("thead", tag("tr", top)), tag("tbody", body), class_="funnel"),
        class_="scroll",
    )


def legend() -> str:
    """What the colours of the bars mean."""
    items = [
        tag("li", _bar([(part, 1.0, "")], 1.0), name)  # a swatch is a bar of one part
        for part, name in _PARTS.items()
    ]
    return tag("ul", *items, class_="legend")


def _row(row: Row, decides: Mapping[str, str]) -> str:
    alone = row["alone"]
    # A rule that must speak keeps out by abstaining, too: what it keeps out alone may be both.
    failed_alone = min(alone, row["failed"])
    parts = [
        ("pass", row["passed"], "passes"),
        ("abstain", row["abstained"], "abstains on"),
        ("fail", row["failed"] - failed_alone, "fails, as others do,"),
        ("alone", failed_alone, "alone keeps out"),
    ]
    name = tag("b", text(row["rule"]))
    if row["required"]:
        name += tag("span", "must not abstain", class_="badge")
    cells = [
        tag("th", name, tag("span", text(decides.get(row["rule"], "")), class_="sub"), scope="row"),
        tag("td", _bar(parts, row["judged"]), class_="bars"),
        tag(
            "td",
            count(row["left_over"]),
            tag("span", _share(row["left_over"], row), class_="sub"),
            class_="n",
        ),
        tag("td", count(row["failed"]), class_="n"),
        tag("td", count(alone), class_="n"),
        tag("td", count(row["near"]), class_="n"),
        tag("td", _margins(row), class_="n"),
    ]
    return tag("tr", *cells)


def _share(part: int, row: Row) -> str:
    return percent(part, row["judged"])


def _margins(row: Row) -> str:
    low, middle = row["margin_p10"], row["margin_p50"]
    if middle is None:
        return NOTHING
    return f"{number(low)} · {number(middle)}"


def _bar(parts: Sequence[tuple[str, float, str]], whole: float) -> str:
    """A stacked bar over the whole width."""
    x = 0.0
    bars = []
    for kind, value, said in parts:
        width = _WIDTH * value / whole if whole else 0.0
        if width:
            tip = tag("title", text(f"{said} {value:,}")) if said else ""
            place = f'x="{x:.2f}" y="0" width="{width:.2f}" height="10"'
            bars.append(f'<rect {place} class="f-{kind}">{tip}</rect>')
        x += width
    view = f"0 0 {_WIDTH:g} 10"
    return tag(
        "svg", *bars, viewBox=view, preserveAspectRatio="none", role="img", aria_label="verdicts"
    )


def overlap_table(rows: Sequence[Row]) -> str:
    """Return a fold: of what a rule fails, how much each other rule fails too."""
    failing = [row for row in rows if row["failed"]]
    if len(failing) < 2:
        return ""
    head = tag("th", "fails …", scope="col") + "".join(
        tag("th", tag("span", text(row["rule"])), scope="col", class_="n") for row in failing
    )
    body = "".join(
        tag(
            "tr",
            tag("th", text(row["rule"]), scope="row"),
            *(_overlap(row, other) for other in failing),
        )
        for row in failing
    )
    table = tag("table", tag("thead", tag("tr", head)), tag("tbody", body), class_="overlap")
    words = tag(
        "p",
        "Of the candidates that the rule on the left fails, the share that the rule above fails, "
        "too. A row of small numbers is a rule that sees what no other sees.",
        class_="how",
    )
    return details(tag("b", "How the rules overlap"), words + tag("div", table, class_="scroll"))


def _overlap(row: Row, other: Row) -> str:
    share = dict(row["fails_too"]).get(other["rule"])
    if share is None:
        return tag("td", class_="n")
    return tag("td", f"{100 * share:.0f} %", class_="n", style=f"--share:{share:.3f}")
