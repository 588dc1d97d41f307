"""`tcrdata evaluate tracking`: tracklets scored against ground truth."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import tracked

if TYPE_CHECKING:
    from tcrdata.evaluation.tracking_scores import TrackingEvaluation


def evaluate_tracking(
    *,
    store: StoreUrl,
    selection: str | None = None,
    out: str | None = None,
    json: Flag = False,
) -> int:
    """Score what `track` made of a selection's labels against ground truth.

    Args:
        store: folder or URL of the store.
        selection: name or id of the labels' selection; the newest that was tracked when left out.
        out: folder for the pictures: overlap over time, and a timeline a sequence.
        json: print protocol and scores as JSON.
    """
    from tcrdata.evaluation.tracking_metrics import evaluate_tracking as score
    from tcrdata.evaluation.tracking_rows import store_tracking_metrics
    from tcrdata.evaluation.tracking_scores import TrackingSettings
    from tcrdata.store import open_store
    from tcrdata.truth_starts import starts_left_out

    opened = open_store(store)
    chosen = tracked(opened, selection)
    settings = TrackingSettings()
    result = score(opened, chosen, settings)
    rounds = opened.read("selections", columns=["round"], selection_id=chosen)
    store_tracking_metrics(opened, chosen, result, settings, rounds["round"][0].as_py())
    if out is not None:
        from tcrdata.track_pictures import draw_tracking

        for path in draw_tracking(opened, chosen, result, out):
            console.say(f"drawn: {path}")
    if not result.curves:
        console.say(
            "no overlap over time and nothing that came back: no tracklet began with a true first "
            f"box; run `tcrdata track --store {shlex.quote(store)} --selection {chosen[:12]} "
            "--init-from truth`, if any is in view"
        )
    elif left_out := starts_left_out(opened, chosen):
        console.say(left_out)
    if json:
        console.print_json(result.to_json())
        return 0
    _print(result)
    return 0


def _print(result: TrackingEvaluation) -> None:
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
    names = ("boxes", "HOTA", "DetA", "AssA", "MOTA", "MOTP", "IDF1", "switches")
    rows = [
        (_named(i.kind), i.hota, i.detection, i.association, i.mota, i.motp, i.idf1, i.switches)
        for i in result.identity
    ]
    if rows:
        console.print_table("identity", names, rows)
    if result.without_identity is not None:
        console.say(result.without_identity)


def _named(kind: str) -> str:
    """Return a kind of series in words."""
    start = "from truth" if kind.startswith("truth") else "from labels"
    if kind == "label":
        return "labels"
    return f"{start}, library {'on' if kind.endswith('library') else 'off'}"
