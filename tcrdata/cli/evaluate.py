"""`tcrdata evaluate`: labels scored against ground truth."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected

if TYPE_CHECKING:
    from tcrdata.evaluation.scoring import Evaluation, Subset


def evaluate(
    *,
    store: StoreUrl,
    selection: str | None = None,
    moving_only: Flag = False,
    json: Flag = False,
) -> int:
    """Score a selection's labels against ground truth.

    Args:
        store: folder or URL of the store.
        selection: name or id; the newest when left out.
        moving_only: recall and average precision on objects that move.
        json: print protocol and scores as JSON.
    """
    from tcrdata.evaluation.protocol import Settings
    from tcrdata.evaluation.scoring import evaluate as score
    from tcrdata.evaluation.scoring import store_metrics
    from tcrdata.plan import ROUND
    from tcrdata.store import open_store

    opened = open_store(store)
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
