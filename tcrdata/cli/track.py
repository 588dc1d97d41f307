"""`tcrdata track`: objects followed over time, through occlusions."""

from __future__ import annotations

import shlex
import time
from typing import Annotated, Literal

from cyclopts import Parameter

from tcrdata import console
from tcrdata.cli.app import Assignments, Flag, StoreUrl
from tcrdata.cli.build import default_workers
from tcrdata.cli.selected import selected
from tcrdata.errors import SettingsError
from tcrdata.settings import parse_assignments


def track(
    *,
    store: StoreUrl,
    selection: str | None = None,
    tracker: Literal["nearest", "correlation", "auto"] = "auto",
    library: Literal["on", "off"] = "on",
    start: Annotated[Literal["labels", "truth"], Parameter(name="--init-from")] = "labels",
    workers: int | None = None,
    assignments: Assignments = (),
    json: Flag = False,
) -> int:
    """Follow the labelled objects over time; what is lost is looked for along a library of paths.

    Args:
        store: folder or URL of the store.
        selection: name or id of the labels' selection; the newest when left out.
        tracker: from one frame to the next: the nearest box, correlation of a template, or both.
        library: whether what is out of sight goes on along the paths of others.
        start: labels, or for evaluation alone the true first box of each object.
        workers: worker processes; the machine's cores when left out.
        assignments: NAME=VALUE of a setting, such as gates.link_gate_m=2, or of the rule that lets
            paths into the library, such as library_entries.min_passable=0.95.
        json: print what was done as JSON.
    """
    from tcrdata.store import open_store
    from tcrdata.track_plans import plan_tracking, units_of
    from tcrdata.track_runs import track as run
    from tcrdata.truth_starts import starts_left_out

    count = workers if workers is not None else default_workers()
    if count < 1:
        raise SettingsError(f"--workers {count}: at least one is needed")
    opened = open_store(store)
    plan = plan_tracking(
        opened,
        selected(opened, selection),
        start=start,
        library=library == "on",
        tracker=tracker,
        assignments=parse_assignments(list(assignments)),
    )
    began = time.perf_counter()
    with console.build_progress(len(units_of(plan))) as bar:
        outcomes = run(store, plan, workers=count, progress=bar.advance)
    made = sum(outcome.state == "made" for outcome in outcomes)
    failed = [outcome for outcome in outcomes if outcome.state == "failed"]
    if json:
        console.print_json({
            "made": made, "done": len(outcomes) - made - len(failed), "failed": len(failed),
            "seconds": round(time.perf_counter() - began, 3),
        })  # fmt: skip
    elif not made and not failed:
        console.say(f"nothing to do: all {len(outcomes)} units were done already")
    else:
        console.say(
            f"{len(plan.sequences)} sequences: {made} units made, "
            f"{len(outcomes) - made - len(failed)} done before, {len(failed)} failed, "
            f"in {time.perf_counter() - began:.1f} s"
        )
    if start == "truth" and (left_out := starts_left_out(opened, plan.selection_id)):
        console.say(left_out)
    if len(failed) == len(outcomes):
        return 1
    console.say(
        f"next: tcrdata evaluate tracking --store {shlex.quote(store)} --selection "
        f"{plan.selection_id[:12]}"
    )
    return 1 if failed else 0
