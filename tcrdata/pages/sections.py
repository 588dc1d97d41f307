"""The parts of a report that are rows of a query, drawn."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from tcrdata import __version__
from tcrdata.pages.reading import Reading
from tcrdata.pages.rule_sheets import RuleBook, first_sentence
from tcrdata.status import store_status
from tcrdata.views.report import funnels, timelines
from tcrdata.views.report.cards import Card, RuleWords, cards
from tcrdata.views.report.charts import Bin, histogram
from tcrdata.views.report.html import count, counted, number, table, tag, text

FUNNEL = (
    "Every rule looks at every candidate. A candidate becomes a label when no rule fails it; "
    "a rule without evidence abstains. <b>Left</b> is what this rule and those above it let "
    "through; <b>alone</b> is what would come in without the rule, and <b>near</b> what of that a "
    "bound looser by a tenth would let in. Margins are distances to the bound as a share of it, "
    "negative where the rule fails: the 10th and the 50th percentile."
)
SCORES = (
    "No cue and no rule has read the ground truth; it is used here alone. The surest labels come "
    "first: a curve that stays high as it goes right finds more objects without more mistakes."
)
LABELS = (
    "How the labels (blue) and what was left undecided (violet) spread. The last bar of each "
    "figure holds everything beyond it, too."
)
TRACKS = (
    "A row is one object, a column one frame. Gaps in a row are frames in which the object was not "
    "tracked; thin grey lines are frames in which it was, and a rule refused the label."
)
GALLERY = (
    "Every picture carries the id of its candidate: <code>tcrdata why ID --store STORE</code> "
    "tells all that is known about it. Left the camera, right the same place from above, ahead is "
    "up: orange points were seen through at other times, so what stood there moved; blue ones were "
    "seen again, so they are static. Dashed yellow is ground truth. The marks below a picture are "
    "the rules in order: filled passes, raised fails, hollow abstains; point at one for its "
    "numbers."
)
RULES = (
    "The text that decided, with its parameters filled in. It runs as it is in any DuckDB shell "
    "over the views that <code>tcrdata views</code> prints."
)
PARAMETERS = (
    "Change any of them without measuring anything again: "
    "<code>tcrdata check --store STORE --set name=value --name mine</code>."
)
LEFT_OUT = ""

_GROUPS = {
    "accepted": (
        "Accepted: a fair sample",
        "Drawn by lot, in turn of the tracks, those in the camera's sight first: nobody chose them "
        "for their looks. The box of the label is blue.",
    ),
    "barely": (
        "Accepted, but only just",
        "The labels that come closest to a bound. If the rules are too lax, it shows here first.",
    ),
    "nearly": (
        "Nearly accepted",
        "One rule alone stands against these, and by little, or the selection left them undecided. "
        "If the rules are too strict, it shows here first.",
    ),
    "rejected": (
        "Rejected",
        "For each rule that is the first to fail candidates some are drawn by lot: here is one of "
        "them, and the one with the most points.",
    ),
}
_DRIVES_LISTED = 1000


def funnel(reading: Reading, book: RuleBook) -> str:
    """Return what each rule does; `tcrdata funnel` prints the same rows."""
    rows = reading.selected("funnel")
    if not rows or not rows[0]["judged"]:
        return tag("p", "The store holds no candidates.", class_="note")
    decides = {name: first_sentence(rule.decides) for name, rule in book.rules.items()}
    return funnels.funnel_table(rows, decides) + funnels.overlap_table(rows)


def labels(reading: Reading) -> str:
    """Return a histogram a quantity."""
    rows = reading.selected("report_distributions")
    if not rows:
        return tag("p", "There are no labels.", class_="note")
    figures = []
    for (name, unit, step), members in itertools.groupby(
        rows, key=lambda row: (row["name"], row["unit"], row["step"])
    ):
        bins = [Bin(row["bin"] * step, row["positives"], row["ignored"]) for row in members]
        each = f"{number(step)} {unit}".strip()
        caption = tag("figcaption", tag("b", text(name)), tag("span", f" · bars of {each}"))
        figures.append(tag("figure", caption, histogram(bins, step, unit, f"Labels by {name}")))
    return tag("div", *figures, class_="multiples three")


def tracks(reading: Reading) -> str:
    """Return the drives with the most labels as timelines, and all of them as a table."""
    rows = reading.selected("report_timeline")
    drives = reading.selected("report_drives", drives_listed=_DRIVES_LISTED)
    if not rows:
        return tag("p", "There are no labels, so there are no tracks to show.", class_="note")
    drawn = len({(row["dataset"], row["sequence"]) for row in rows})
    parts = [timelines.legend(), timelines.timelines(rows)]
    if len(drives) > drawn:
        listed = [
            [
                text(f"{row['dataset']}/{row['sequence']}"),
                *(count(row[name]) for name in _DRIVE_COLUMNS),
            ]
            for row in drives
        ]
        head = ["drive", *_DRIVE_COLUMNS.values()]
        more = drives[0]["drives"] - len(drives)
        what = f"All {counted(drives[0]['drives'], 'drive')}; drawn: the {drawn} with most labels"
        parts += [
            tag("h3", what),
            tag("div", table(head, listed), class_="tall"),
            tag("p", f"{counted(more, 'more drive')} not listed.", class_="how") if more else "",
        ]
    return "".join(parts)


_DRIVE_COLUMNS = {
    "frames": "frames",
    "frames_failed": "unreadable",
    "candidates": "candidates",
    "positives": "labels",
    "ignored": "ignored",
    "tracks": "tracks",
    "frames_with_labels": "frames with labels",
}


def examples(groups: Mapping[str, list[Card]], words: Mapping[str, RuleWords]) -> str:
    """Return the gallery, kind by kind."""
    if not groups:
        return tag("p", "The store holds no candidates.", class_="note")
    parts = []
    for kind, (title, told) in _GROUPS.items():
        found = groups.get(kind)
        parts += [tag("h3", title), tag("p", told, class_="how")]
        parts.append(cards(found, words) if found else tag("p", "There is none.", class_="note"))
    return "".join(parts)


def left_out(reading: Reading) -> str:
    """Return unreadable frames and failed units, or that there are none."""
    rows = reading.rows("report_left_out")
    found = store_status(reading.store)
    failed = [(where, what) for where, frame, what in found.problems if frame is None]
    parts = []
    if rows:
        parts.append(
            table(["drive", "what", "frames", "from", "to", "why"], _message_rows(rows), 9)
        )
        more = rows[0]["messages"] - len(rows)
        if more:
            parts.append(tag("p", f"{counted(more, 'more message')} not listed.", class_="how"))
    if failed:
        shown = [[text(where), text(what)] for where, what in failed[:_DRIVES_LISTED]]
        parts += [tag("h3", "Stages that failed"), table(["where", "why"], shown, 9)]
    if found.missing:
        parts.append(
            tag("p", f"{counted(found.missing, 'unit')} of work not done yet.", class_="note")
        )
    if not parts:
        return tag(
            "p", "Nothing: every frame could be read, and every stage is done.", class_="note"
        )
    return "".join(parts)


def _message_rows(rows: list[dict[str, Any]]) -> list[list[str]]:
    return [
        [
            text(f"{row['dataset']}/{row['sequence']}"),
            text(row["what"]),
            count(row["frames"]),
            text(row["first_frame"]),
            text(row["last_frame"]),
            text(row["message"]),
        ]
        for row in rows
    ]


def footer(reading: Reading) -> str:
    """Return how to make the page again."""
    name = reading.selection["selection_id"]
    command = f"tcrdata report --store {reading.store.url} --selection {name} --out report.html"
    return f"tcrdata {text(__version__)} · {tag('code', text(command))}"
