"""`tcrdata models`: what was trained in a store."""

from __future__ import annotations

import json as json_text
import shlex

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl

SHOWN = (
    "model_id", "kind", "network", "labels", "seed", "samples", "step", "steps", "first_loss",
    "last_loss", "state",
)  # fmt: skip


def models(*, store: StoreUrl, kind: str | None = None, json: Flag = False) -> int:
    """Show what was trained: on which labels and snapshot, with which settings and losses.

    The state of a flow network says whether it was promoted, and which one is in use.

    Args:
        store: folder or URL of the store.
        kind: detector, segmenter or flow; all when left out.
        json: print every model with its settings as JSON.
    """
    from tcrdata.flow_models import flow_models
    from tcrdata.reports import run_report
    from tcrdata.store import open_store

    opened = open_store(store)
    connection = opened.connect(tables=("models", "selections"))
    relation = run_report(connection, "models", {"trained_kind": kind})
    names = relation.columns
    rows = [dict(zip(names, row, strict=True)) for row in relation.fetchall()]
    flows = {row["model_id"]: row for row in flow_models(opened)}
    for row in rows:
        row["settings"] = json_text.loads(row["settings"])
        row["state"] = "finished" if row["finished"] else "unfinished"
        if row["finished"] and (found := flows.get(row["model_id"])):
            row["state"] = f"{found['state']}, in use" if found["in_use"] else found["state"]
    if json:
        console.print_json(rows)
        return 0
    console.print_table("models", SHOWN, [[row[name] for name in SHOWN] for row in rows])
    where = shlex.quote(store)
    unfinished = [row["kind"] for row in rows if not row["finished"]]
    if unfinished:
        console.say(
            f"next: tcrdata train {unfinished[0]} --store {where} --resume, with the options "
            "that it began with"
        )
    elif not rows:
        console.say(f"no model yet; next: tcrdata train detector --store {where}")
    return 0
