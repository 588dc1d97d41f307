"""Colours that the colour-blind can tell apart, on a dark ground that suits photographs and points.

Kinds of boxes differ in line style too, so that a grey print still tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

BACKGROUND = "#11151c"
PANEL = "#161b24"
GRID = "#2d3644"
TEXT = "#e4e9f1"
MUTED = "#93a0b4"
SEEN_THROUGH = "#ff9440"
SEEN_AGAIN = "#6d93bd"
NO_VOTE = "#5b6880"
EGO = "#e4e9f1"
TRACKS = ("#4cc9f0", "#ff9440", "#f2e863", "#e58bb8", "#5fd3a5", "#b79bea", "#9fb4cc")


@dataclass(frozen=True)
class BoxStyle:
    """How one kind of box is drawn.

    Attributes:
        color: of lines and filling.
        dashes: on and off, in line widths; empty for a solid line.
        width_pt: of lines.
        alpha: of lines.
        fill_alpha: of the filling from above and of the front face in the image.
        halo: a dark rim keeps the lines legible on bright pixels.
        order: kinds of higher order are drawn later.
    """

    color: str
    dashes: tuple[float, ...]
    width_pt: float
    alpha: float
    fill_alpha: float
    halo: bool
    order: int


STYLES = {
    "asked": BoxStyle("#ffffff", (), 1.4, 1.0, 0.12, True, 5),
    "labels": BoxStyle("#4cc9f0", (), 1.2, 1.0, 0.22, True, 3),
    "truth": BoxStyle("#f2e863", (4.0, 2.2), 0.9, 1.0, 0.0, True, 4),
    "ignored": BoxStyle("#b79bea", (5.0, 1.5, 1.0, 1.5), 0.8, 0.9, 0.0, False, 2),
    "rejected": BoxStyle("#ef8fc0", (1.6, 1.3), 0.8, 0.9, 0.0, False, 1),
}


def box_style(kind: str) -> BoxStyle:
    """Return the style of a kind of boxes; unknown kinds look like `ignored`."""
    return STYLES.get(kind, STYLES["ignored"])


def in_drawing_order(kinds: list[str]) -> list[str]:
    """Sort kinds so that what matters most is drawn last."""
    return sorted(kinds, key=lambda kind: (box_style(kind).order, kind))


def in_legend_order(kinds: list[str]) -> list[str]:
    """Sort kinds as they are named: labels, truth, then the rest."""
    names = list(STYLES)
    return sorted(kinds, key=lambda kind: (names.index(kind) if kind in names else 99, kind))


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0 to 255, of a colour such as `#20c0ff`."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue
