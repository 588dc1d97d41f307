"""Pieces of HTML: everything that comes from a store is escaped here, once."""

from __future__ import annotations

import html
import math
from typing import Any

NOTHING = "–"
_PLAIN_UNITS = {"", "share", "ratio", "estimator", "source", "fit"}


def text(value: object) -> str:
    """Escape a value for element content and quoted attributes."""
    return html.escape(str(value), quote=True)


def tag(name: str, *content: str, **attributes: object) -> str:
    """Return an element around content that is HTML already.

    Args:
        name: of the element.
        *content: HTML.
        **attributes: escaped; a trailing underscore is dropped, others become dashes; None drops
            the attribute.
    """
    parts = [
        f' {key.rstrip("_").replace("_", "-")}="{text(value)}"'
        for key, value in attributes.items()
        if value is not None
    ]
    return f"<{name}{''.join(parts)}>{''.join(content)}</{name}>"


def count(value: int | None) -> str:
    """A whole number with thousands apart."""
    return NOTHING if value is None else f"{value:,}"


def counted(value: int, noun: str) -> str:
    """A whole number with its noun, in the plural where it must be."""
    return f"{value:,} {noun}{'' if value == 1 else 's'}"


def number(value: float | None) -> str:
    """Three significant digits; an infinite bound can never be met."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if float(value).is_integer() and abs(value) < 1e6:
        return f"{value:,.0f}".replace("-", "−")
    digits = min(max(0, 2 - math.floor(math.log10(abs(value)))), 4)
    shown = f"{value:,.{digits}f}"
    return (shown.rstrip("0").rstrip(".") if digits else shown).replace("-", "−")


def measure(value: float | None, unit: str) -> str:
    """A number with its unit, as plain text; shares and names have none."""
    shown = number(value)
    return shown if unit in _PLAIN_UNITS or shown == NOTHING else f"{shown} {unit}"


def percent(part: float, whole: float) -> str:
    """Share in per cent; a dash of nothing."""
    if not whole:
        return NOTHING
    share = 100 * part / whole
    return f"{share:.0f} %" if share >= 10 or share == 0 else f"{share:.1f} %"


def score(value: float | None) -> str:
    """A score in [0, 1], with three digits."""
    return NOTHING if value is None else f"{value:.3f}"


def table(head: list[str], rows: list[list[str]], numeric_from: int = 1, **attributes: Any) -> str:
    """Return a table in a box that scrolls sideways by itself; cells are HTML already.

    Args:
        head: of the columns.
        rows: cells.
        numeric_from: columns from here on are aligned to the right.
        **attributes: of the table.
    """
    kinds = [None if index < numeric_from else "n" for index in range(len(head))]
    top = "".join(
        tag("th", cell, scope="col", class_=k) for cell, k in zip(head, kinds, strict=True)
    )
    body = "".join(
        tag("tr", *(tag("td", cell, class_=k) for cell, k in zip(row, kinds, strict=True)))
        for row in rows
    )
    inner = tag("table", tag("thead", tag("tr", top)), tag("tbody", body), **attributes)
    return tag("div", inner, class_="scroll")


def details(summary: str, content: str, **attributes: Any) -> str:
    """Return what opens on a click; both arguments are HTML."""
    return tag("details", tag("summary", summary), content, **attributes)
