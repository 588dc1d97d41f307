"""Line and bar charts as inline SVG; their text stays readable, since they never shrink much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.views.report.html import number, tag, text

_WIDTH, _HEIGHT = 300.0, 252.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 34.0, 12.0, 24.0, 84.0
_FOOT = _HEIGHT - _BOTTOM
_BAR_HEIGHT = 128.0
_BAR_LEFT = 6.0


@dataclass(frozen=True)
class Line:
    """One line of a chart over [0, 1] x [0, 1].

    Attributes:
        name: shown at the line.
        told: shown on hovering.
        x: (K,).
        y: (K,).
    """

    name: str
    told: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]


@dataclass(frozen=True)
class Bin:
    """One bin of a histogram, `low` to `low + step`."""

    low: float
    positives: int
    ignored: int


def unit_chart(lines: Sequence[Line], x_name: str, y_name: str, title: str) -> str:
    """Return a chart of lines in the unit square, as steps.

    Args:
        lines: at most three, from the widest and lightest to the thinnest and darkest, so that
            all are seen where they coincide.
        x_name: below.
        y_name: above, to the left.
        title: read aloud in place of the picture.
    """
    parts = [_unit_grid(x_name, y_name)]
    for place, line in enumerate(lines):
        parts.append(
            tag(
                "path",
                tag("title", text(line.told)),
                d=_steps(line.x, line.y),
                class_=f"curve c{place}",
            )
        )
    parts.append(_legend(lines))
    view = f"0 0 {_WIDTH:g} {_HEIGHT:g}"
    return tag("svg", *parts, viewBox=view, class_="chart", role="img", aria_label=title)


def _unit_grid(x_name: str, y_name: str) -> str:
    parts = []
    for level in (0.0, 0.25, 0.5, 0.75, 1.0):
        x, y = _place(level, level)
        kind = "base" if level == 0 else "grid"
        parts.append(_line(_LEFT, y, _WIDTH - _RIGHT, y, kind))
        name = f"{level:g}"
        parts.append(tag("text", name, x=_LEFT - 6, y=f"{y + 3.5:.1f}", text_anchor="end"))
        parts.append(tag("text", name, x=f"{x:.1f}", y=_FOOT + 15, text_anchor="middle"))
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(tag("text", text(x_name), x=f"{middle:g}", y=_FOOT + 28, text_anchor="middle"))
    parts.append(tag("text", text(y_name), x=2, y=11))
    return "".join(parts)


def _legend(lines: Sequence[Line]) -> str:
    """Names below the plot, where no curve can pass."""
    parts = []
    for place, line in enumerate(lines):
        y = _FOOT + 47 + 16 * place
        swatch = f"M{_LEFT + 10:g} {y - 4:g}h20"
        parts.append(f'<path d="{swatch}" class="curve c{place}"/>')
        parts.append(tag("text", text(line.name), x=_LEFT + 37, y=f"{y:g}", class_="name"))
    return "".join(parts)


def _place(x: float, y: float) -> tuple[float, float]:
    return (
        _LEFT + x * (_WIDTH - _LEFT - _RIGHT),
        _FOOT - y * (_FOOT - _TOP),
    )


def _steps(x: NDArray[np.floating], y: NDArray[np.floating]) -> str:
    """A path from the left edge through the points, to the right and then up or down."""
    if not len(x):
        return ""
    points = [_place(float(a), float(b)) for a, b in zip(x, y, strict=True)]
    path = [f"M{_LEFT:g} {points[0][1]:.1f}"]
    path += [f"L{a:.1f} {b:.1f}" for a, b in points]
    return "".join(path)


def histogram(bins: Sequence[Bin], step: float, unit: str, title: str) -> str:
    """Return a histogram; the last bin is open to the right.

    Args:
        bins: rising, gaps allowed.
        step: width of a bin.
        unit: of the axis.
        title: read aloud in place of the picture.
    """
    first = min(bin_.low for bin_ in bins)
    places = round((max(bin_.low for bin_ in bins) - first) / step) + 1
    width = (_WIDTH - 2 * _BAR_LEFT) / max(places, 6)
    most = max(bin_.positives + bin_.ignored for bin_ in bins)
    ground = _BAR_HEIGHT - 20
    parts = [_line(_BAR_LEFT, ground, _WIDTH - _BAR_LEFT, ground, "base")]
    for bin_ in bins:
        x = _BAR_LEFT + round((bin_.low - first) / step) * width
        parts.append(_column(bin_, x, width, ground, (ground - 14) / most, step, unit))
    for tick in _ticks(first, places, step):
        x = _BAR_LEFT + (tick - first) / step * width
        parts.append(
            tag("text", number(tick), x=f"{x:.1f}", y=_BAR_HEIGHT - 5, text_anchor="middle")
        )
    parts.append(tag("text", f"most {most:,}", x=_WIDTH - _BAR_LEFT, y=9, text_anchor="end"))
    view = f"0 0 {_WIDTH:g} {_BAR_HEIGHT:g}"
    return tag("svg", *parts, viewBox=view, class_="chart", role="img", aria_label=title)


def _column(
    bin_: Bin, x: float, width: float, ground: float, scale: float, step: float, unit: str
) -> str:
    """A bar: labels below, ignored ones on top."""
    told = f"{number(bin_.low)} to {number(bin_.low + step)} {unit}: {bin_.positives:,} labels"
    if bin_.ignored:
        told += f", {bin_.ignored:,} ignored"
    parts = [tag("title", text(told))]
    y = ground
    for value, kind in ((bin_.positives, "label"), (bin_.ignored, "ignored")):
        if value:
            height = max(value * scale, 1.0)
            y -= height
            parts.append(_rect(x + 0.5, y, max(width - 1, 0.5), height, f"bar-{kind}"))
    return tag("g", *parts)


def _ticks(first: float, places: int, step: float) -> list[float]:
    """Edges to name: about five, on round numbers."""
    every = step * max(1, math.ceil(places / 5))
    start = math.ceil(first / every - 1e-9) * every
    reach = first + max(places, 6) * step
    return [start + n * every for n in range(int((reach - start) / every + 1e-9) + 1)]


def _rect(x: float, y: float, width: float, height: float, kind: str) -> str:
    return (
        f'<rect x="{x:.2f}" y="{y:.2f}" width="{width:.2f}" height="{height:.2f}" class="{kind}"/>'
    )


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{kind}"/>'
