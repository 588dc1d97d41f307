"""The page itself: one file, style and script inside, that asks no network for anything."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tcrdata.views import palette
from tcrdata.views.report.html import tag, text

_HERE = Path(__file__).parent

# On paper and on white the palette's colours would glare: the same hues, darker.
_LIGHT = {
    "label": "#0a7ea8",
    "truth": "#9a7b00",
    "ignored": "#7455b5",
    "rejected": "#b83b82",
    "through": "#cf5f00",
    "again": "#5c81ab",
    "novote": "#a3acba",
}


def _dark() -> dict[str, str]:
    styles = palette.STYLES
    return {
        "label": styles["labels"].color,
        "truth": styles["truth"].color,
        "ignored": styles["ignored"].color,
        "rejected": styles["rejected"].color,
        "through": palette.SEEN_THROUGH,
        "again": palette.SEEN_AGAIN,
        "novote": palette.NO_VOTE,
    }


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        name: its anchor.
        short: its name among the links.
        title: its heading.
        lead: HTML, how to read it.
        content: HTML.
    """

    name: str
    short: str
    title: str
    lead: str
    content: str


def document(title: str, masthead: str, sections: list[Section], footer: str) -> str:
    """Return the whole page.

    Args:
        title: plain text, of the window.
        masthead: HTML above the sections.
        sections: in order.
        footer: HTML below them.
    """
    links = "".join(tag("a", text(s.short), href=f"#{s.name}") for s in sections)
    parts = "".join(
        tag(
            "section",
            tag("h2", text(s.title)),
            tag("p", s.lead, class_="lead") if s.lead else "",
            s.content,
            id=s.name,
        )
        for s in sections
    )
    head = (
        '<meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        '<link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{_style()}</style>"
    )
    body = (
        f'<header class="masthead">{masthead}</header><nav aria-label="Sections">{links}</nav>'
        f"<main>{parts}</main><footer>{footer}</footer><script>{_read('report.js')}</script>"
    )
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _style() -> str:
    """The style sheet behind the palette's colours, as variables for light and dark."""
    light, dark = (
        "".join(f"--{name}:{colour};" for name, colour in colours.items())
        for colours in (_LIGHT, _dark())
    )
    on_photo = "".join(f"--{name}-photo:{colour};" for name, colour in _dark().items())
    return (
        f":root{{{light}{on_photo}}}@media (prefers-color-scheme: dark){{:root{{{dark}}}}}"
        + _read("report.css")
    )


def _read(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
