"""Drives as rows of tracks over frames; text is HTML, so that it never shrinks with the bars."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tcrdata.views.report.html import counted, score, tag, text

Row = Mapping[str, Any]
KINDS = {
    "observed": "observed: points of its own",
    "occluded": "observed, mostly hidden",
    "gap": "filled in between sightings",
    "extended": "filled in before the first or after the last",
    "ignored": "ignored",
    "rejected": "track seen, no label",
}
_TICKS = 10
_STEPS = [digit * 10**power for power in range(9) for digit in (1, 2, 5)]
_PLACES = {"rejected": (4.3, 1.4), "ignored": (2.6, 4.8)}
_FULL = (0.6, 8.8)


def timelines(rows: Iterable[Row]) -> str:
    """Return a figure a drive.

    Args:
        rows: of `report_timeline`, in its order.
    """
    drives = itertools.groupby(rows, key=lambda row: (row["dataset"], row["sequence"]))
    return "".join(_drive(list(members)) for _, members in drives)


def legend() -> str:
    """The kinds of bars with their colours."""
    items = [
        tag(
            "li",
            tag("svg", _bar(kind, 0, 10), viewBox="0 0 10 10", preserveAspectRatio="none"),
            name,
        )
        for kind, name in KINDS.items()
    ]
    return tag("ul", *items, class_="legend")


def _drive(rows: list[Row]) -> str:
    first = rows[0]
    start, end = first["drive_first"], first["drive_last"]
    tracks = [list(m) for _, m in itertools.groupby(rows, key=lambda row: row["track_place"])]
    hidden = first["drive_tracks"] - len(tracks)
    more = f"; {counted(hidden, 'shorter track')} not drawn" if hidden else ""
    caption = tag(
        "figcaption",
        tag("b", text(first["sequence"])),
        tag(
            "span",
            f" · {counted(first['drive_labels'], 'label')} on "
            f"{counted(first['drive_tracks'], 'track')}, frames {start} to {end}{more}",
        ),
    )
    lines = "".join(_track(track, start, end) for track in tracks)
    axis = tag("span", "frame") + _axis(start, end) + tag("span")
    return tag("figure", caption, tag("div", lines, axis, class_="tracks"), class_="drive")


def _track(runs: Sequence[Row], start: int, end: int) -> str:
    first = runs[0]
    name = first["track_id"].rpartition("/")[2] if first["track_id"] else "no track"
    bars = "".join(
        _bar(run["kind"], run["first_frame"] - start, run["last_frame"] + 1 - start, _told(run))
        for run in runs
    )
    view = f"0 0 {end - start + 1} 10"
    picture = tag(
        "svg", bars, viewBox=view, preserveAspectRatio="none", role="img", aria_label=name
    )
    tip = f"{first['track_id']}: mean score {score(first['mean_score'])}"
    return tag("span", text(name), title=tip) + picture + tag("span", f"{first['track_labels']:,}")


def _told(run: Row) -> str:
    frames = f"frame {run['first_frame']}"
    if run["last_frame"] != run["first_frame"]:
        frames = f"frames {run['first_frame']} to {run['last_frame']}"
    return f"{KINDS[run['kind']]}, {frames}"


def _bar(kind: str, first: float, end: float, told: str = "") -> str:
    y, height = _PLACES.get(kind, _FULL)
    tip = tag("title", text(told)) if told else ""
    return (
        f'<rect x="{first:g}" y="{y}" width="{end - first:g}" height="{height}" '
        f'class="k-{kind}">{tip}</rect>'
    )


def _axis(start: int, end: int) -> str:
    """Frame numbers under the bars, each below the middle of its frame."""
    span = end - start + 1
    step = next(s for s in _STEPS if s * _TICKS >= span)
    frames = range(-(-start // step) * step, end + 1, step)
    marks = [
        tag("i", str(frame), style=f"left:{100 * (frame - start + 0.5) / span:.2f}%")
        for frame in frames
    ]
    return tag("div", *marks, class_="axis")
