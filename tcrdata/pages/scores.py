"""Scores of a selection against ground truth, where there is any: the one part that reads truth."""

from __future__ import annotations

from dataclasses import dataclass

from tcrdata.errors import MissingEvidenceError
from tcrdata.evaluation.curves import Curve, precision_recall_curves
from tcrdata.evaluation.protocol import Settings, View
from tcrdata.evaluation.scoring import SUBSETS, Evaluation, Subset, scored, tally_selection
from tcrdata.pages.reading import Reading
from tcrdata.views.report.charts import Line, unit_chart
from tcrdata.views.report.html import counted, details, score, table, tag, text

SHOWN_IOUS = (0.3, 0.5, 0.7)
_VIEWS: dict[View, str] = {"bev": "from above", "2d": "in the image"}
_SUBSETS: dict[Subset, str] = {"all": "All labelled objects", "moving": "Moving objects"}
_METRICS = {
    "ap_per_frame": "average precision, mean over frames",
    "ap_pooled": "average precision, all frames pooled",
    "precision": "precision",
    "recall": "recall",
}


@dataclass(frozen=True)
class Scores:
    """What ground truth says of a selection.

    Attributes:
        evaluation: every score.
        curves: at the overlaps shown.
    """

    evaluation: Evaluation
    curves: list[Curve]

    def value(self, subset: Subset, metric: str, iou: float, view: View = "bev") -> float | None:
        """One score over all sequences."""
        return self.evaluation.find(subset, view, metric)[iou].value

    def labels_scored(self, iou: float) -> int:
        """Labels that the bird's-eye precision counts."""
        return self.evaluation.find("all", "bev", "precision")[iou].predictions


def read_scores(reading: Reading) -> Scores | str:
    """Score the selection, or say why it cannot be scored."""
    settings = Settings()
    try:
        tallied = tally_selection(
            reading.store, reading.selection["selection_id"], settings, reading.sequences
        )
    except MissingEvidenceError as error:
        return str(error)
    return Scores(scored(tallied, settings), precision_recall_curves(tallied, settings, SHOWN_IOUS))


def score_section(scores: Scores | str) -> str:
    """Return the curves, the table and the protocol, or why there are none."""
    if isinstance(scores, str):
        return tag("p", f"Not scored: {text(scores)}.", class_="note")
    evaluation = scores.evaluation
    left_out = len(evaluation.without_truth)
    drives = counted(len(evaluation.sequences), "drive") + " with labelled objects"
    if left_out:
        drives += f"; {counted(left_out, 'drive')} without, left out"
    protocol = "".join(tag("p", text(line)) for line in evaluation.protocol.splitlines())
    return (
        tag("div", *_figures(scores.curves), class_="multiples")
        + _table(scores)
        + tag("p", f"{drives}, {counted(evaluation.frames, 'frame')}.", class_="how")
        + details("How this is scored", protocol)
    )


def _figures(curves: list[Curve]) -> list[str]:
    figures = []
    for subset, subset_name in _SUBSETS.items():
        for view, view_name in _VIEWS.items():
            chosen = [c for c in curves if (c.subset, c.view) == (subset, view)]
            if not chosen or not chosen[0].truths:
                continue
            lines = [_line(curve) for curve in chosen]
            truths = counted(chosen[0].truths, "object")
            caption = tag(
                "figcaption",
                tag("b", f"{subset_name}, {view_name}"),
                tag("span", f" · {truths}, {counted(chosen[0].predictions, 'label')}"),
            )
            title = f"Precision over recall, {subset_name.lower()}, {view_name}"
            chart = unit_chart(lines, "recall", "precision", title)
            figures.append(tag("figure", caption, chart))
    return figures


def _line(curve: Curve) -> Line:
    average = score(curve.average_precision)
    name = f"IoU {curve.iou:g}: AP {average}"
    return Line(name, f"{name} (pooled)", curve.recall, curve.precision)


def _table(scores: Scores) -> str:
    """Metrics by overlap; precision knows no subset, since a label on a parked car is not wrong."""
    rows = []
    for metric, name in _METRICS.items():
        for subset in SUBSETS[:1] if metric == "precision" else SUBSETS:
            values = [
                score(scores.value(subset, metric, iou, view))
                for view in _VIEWS
                for iou in SHOWN_IOUS
            ]
            told = name if metric == "precision" else f"{name}, {subset}"
            rows.append([text(told), *values])
    head = ["", *(f"{v} {iou:g}" for v in ("above", "image") for iou in SHOWN_IOUS)]
    return table(head, rows)
