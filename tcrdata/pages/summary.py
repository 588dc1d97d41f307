"""The head of a report: what was selected, from what, and how far it can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcrdata import __version__
from tcrdata.pages.reading import Reading
from tcrdata.pages.rule_sheets import RuleBook, changed_parameters
from tcrdata.pages.scores import Scores
from tcrdata.views.report.html import NOTHING, count, counted, percent, tag, text

Row = Mapping[str, Any]
_IOU = 0.5


def masthead(reading: Reading, row: Row, scores: Scores | str, book: RuleBook) -> str:
    """Return title, the verdict in a sentence, tiles of counts, and the facts."""
    return "".join(
        (
            tag("p", "Label report", class_="kicker"),
            tag("h1", text(row["name"])),
            tag("p", _verdict(row, scores), class_="verdict"),
            _tiles(row, scores),
            tag("dl", _facts(reading, row, book), class_="facts"),
        )
    )


def _verdict(row: Row, scores: Scores | str) -> str:
    """What came out, from what, and what ground truth says of it."""
    found = tag("b", counted(row["positives"], "label"))
    on = f" on {counted(row['tracks'], 'track')}" if row["tracks"] else ""
    said = (
        f"{found}{on}, out of {counted(row['proposals_judged'], 'candidate')} in "
        f"{counted(row['frames'], 'frame')} of {counted(row['drives'], 'drive')}. "
    )
    if isinstance(scores, str):
        return said + "There is no ground truth to score them with."
    precision = scores.value("all", "precision", _IOU)
    recall, moving = (scores.value(subset, "recall", _IOU) for subset in ("all", "moving"))
    if precision is not None:
        checked = counted(scores.labels_scored(_IOU), "label")
        said += (
            f"Of the {checked} that ground truth can check, {tag('b', _share(precision))} meet a "
        )
        said += f"labelled object (IoU {_IOU:g} from above). "
    if recall is not None:
        said += f"They cover {tag('b', _share(recall))} of all labelled objects"
        said += (
            f" and {tag('b', _share(moving))} of those that move." if moving is not None else "."
        )
    return said


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _tiles(row: Row, scores: Scores | str) -> str:
    """Counts in a grid of two full rows."""
    shown = [
        (count(row["positives"]), "labels"),
        (count(row["ignored"]), "ignored: left undecided"),
        (count(row["tracks"]), "tracks with a label"),
        (count(row["proposals_judged"]), "candidates judged"),
        (percent(row["positives"], row["proposals_judged"]), "of them accepted"),
        (f"{count(row['frames_with_labels'])} / {count(row['frames'])}", "frames with a label"),
        (f"{count(row['drives_with_labels'])} / {count(row['drives'])}", "drives with a label"),
        (count(row["frames_failed"]), "frames that could not be read"),
    ]
    if isinstance(scores, Scores):
        checked = {
            f"precision, IoU {_IOU:g}": scores.value("all", "precision", _IOU),
            f"recall of what moves, IoU {_IOU:g}": scores.value("moving", "recall", _IOU),
        }
        for name, value in checked.items():
            shown.append((NOTHING if value is None else _share(value), name))
    tiles = "".join(
        tag("div", tag("b", value), tag("span", text(name)), class_="tile") for value, name in shown
    )
    return tag("div", tiles, class_="tiles", style=f"--columns:{len(shown) // 2}")


def _facts(reading: Reading, row: Row, book: RuleBook) -> str:
    changed = changed_parameters(reading.selection, book)
    settings = ", ".join(
        f"{tag('code', text(name))} = {tag('span', text(value), class_='changed')} "
        f"(preset: {text(was)})"
        for name, value, was in changed
    )
    if not settings:
        settings = "as the preset has them" if book.preset else "see the rules below"
    facts = [
        ("store", text(reading.store.url)),
        ("data", text(", ".join(row["datasets"]) or NOTHING)),
        ("selection", f"{tag('code', text(row['selection_id']))}, round {row['round']}"),
        ("preset", f"{text(row['preset'])}, {counted(row['rules'], 'rule')}"),
        ("parameters", settings),
        ("evidence", f"snapshot {tag('code', text(row['snapshot']))}"),
        ("made by", f"tcrdata {text(__version__)}"),
    ]
    if reading.sequences:
        facts.insert(1, ("drives shown", text(", ".join(reading.sequences))))
    return "".join(tag("dt", name) + tag("dd", value) for name, value in facts)
