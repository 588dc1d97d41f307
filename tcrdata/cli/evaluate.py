"""`tcrdata evaluate`: labels scored against ground truth."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Literal

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.errors import SettingsError

if TYPE_CHECKING:
    from tcrdata.evaluation.scoring import Evaluation, Subset
    from tcrdata.store import Store


def evaluate(
    what: Literal["labels", "tracking"] = "labels",
    /,
    *,
    store: StoreUrl,
    selection: str | None = None,
    moving_only: Flag = False,
    out: str | None = None,
    json: Flag = False,
) -> int:
    """Score a selection's labels, or what `track` made of them, against ground truth.

    Args:
        what: labels or tracking.
        store: folder or URL of the store.
        selection: name or id; the newest when left out.
        moving_only: of labels, recall and average precision on objects that move.
        out: of tracking, a folder for the pictures: overlap over time, and a timeline a sequence.
        json: print protocol and scores as JSON.
    """
    from tcrdata.evaluation.protocol import Settings
    from tcrdata.evaluation.scoring import evaluate as score
    from tcrdata.evaluation.scoring import store_metrics
    from tcrdata.plan import ROUND
    from tcrdata.store import open_store

    opened = open_store(store)
    if what == "tracking":
        if moving_only:
            raise SettingsError("--moving-only is of labels: tracking tells both apart by itself")
        return _tracking(opened, selected(opened, selection), out, json=json)
    if out is not None:
        raise SettingsError("--out is of `evaluate tracking`: draw labels with `tcrdata draw`")
    settings = Settings(moving_only=moving_only)
    result = score(opened, selected(opened, selection), settings)
    store_metrics(opened, result, settings, ROUND)
    if json:
        console.print_json(result.to_json())
        return 0
    sys.stdout.write(result.protocol + "\n\n")
    for name in result.without_truth:
        console.say(f"left out: {name} has no ground truth")
    rows = _score_rows(result, ("moving",) if moving_only else ("all", "moving"))
    console.print_table("", ("score", "view", *map(str, settings.ious)), rows)
    return 0


def _tracking(store: Store, selection_id: str, out: str | None, *, json: bool) -> int:
    """Score tracklets and the labels' tracks."""
    from tcrdata.evaluation.tracking_metrics import evaluate_tracking

    result = evaluate_tracking(store, selection_id)
    if out is not None:
        from tcrdata.track_pictures import draw_tracking

        for path in draw_tracking(store, selection_id, result, out):
            console.say(f"drawn: {path}")
    if json:
        console.print_json(result.to_json())
        return 0
    sys.stdout.write(result.protocol + "\n\n")
    steps = (0, 1, 4, 9, 14, 19)
    curves = [
        (f"{_named(c.kind)}, {c.subset}", *(c.iou[s] for s in steps), c.objects[0])
        for c in result.curves
    ]
    if curves:
        console.print_table(
            "overlap after so many frames", ("tracklets", *map(str, steps), "objects"), curves
        )
    ends = [
        (_named(e.kind), e.recall, e.recall_throughout, e.precision, e.objects, e.tracklets)
        for e in result.ends
    ]
    columns = ("tracklets", "recall", "throughout", "precision", "objects", "tracklets on one")
    console.print_table("from the first to the last frame", columns, ends)
    back = [(_named(r.kind), r.how, r.recovered, r.returns) for r in result.recoveries]
    if back:
        console.print_table("came back", ("tracklets", "hidden", "recovered", "of"), back)
    columns = ("boxes", "HOTA", "DetA", "AssA", "MOTA", "MOTP", "IDF1", "switches")
    rows = [
        (_named(i.kind), i.hota, i.detection, i.association, i.mota, i.motp, i.idf1, i.switches)
        for i in result.identity
    ]
    console.print_table("identity", columns, rows)
    return 0


def _named(kind: str) -> str:
    """Return a kind of series in words."""
    start = "from truth" if kind.startswith("truth") else "from labels"
    if kind == "label":
        return "labels"
    return f"{start}, library {'on' if kind.endswith('library') else 'off'}"


def _score_rows(result: Evaluation, subsets: tuple[Subset, ...]) -> list[tuple[Any, ...]]:
    """One row a metric, subset and view, over all sequences; precision knows no subset."""
    from tcrdata.evaluation.protocol import VIEWS
    from tcrdata.evaluation.scoring import METRICS

    rows: list[tuple[Any, ...]] = []
    for metric in METRICS:
        for subset in subsets[:1] if metric == "precision" else subsets:
            for view in VIEWS:
                found = result.find(subset, view, metric)
                values = [found[iou].value for iou in sorted(found)]
                name = metric.replace("_", " ")
                rows.append((name if metric == "precision" else f"{name}, {subset}", view, *values))
    return rows
