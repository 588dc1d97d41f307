"""`tcrdata check`: labels selected again from stored evidence."""

from __future__ import annotations

import shlex
import time

from tcrdata import console
from tcrdata.cli import printing
from tcrdata.cli.app import Assignments, Flag, StoreUrl
from tcrdata.settings import parse_assignments


def check(
    *,
    store: StoreUrl,
    preset: str = "tcrdata",
    assignments: Assignments = (),
    name: str | None = None,
    round: int = 1,
    snapshot: str | None = None,
    json: Flag = False,
) -> int:
    """Select labels again from stored evidence; nothing is measured anew.

    Args:
        store: folder or URL of the store.
        preset: name of a preset, or the path of one.
        assignments: `parameter=value` of a rule, such as max_cycle_error_m=0.1.
        name: name of the selection; the preset's when left out.
        round: EM round whose models are heard, beside what was measured once.
        snapshot: judge the evidence of this snapshot; that of this moment when left out.
        json: print the selection as JSON.
    """
    from tcrdata.rules import select
    from tcrdata.store import open_store

    started = time.perf_counter()
    selection = select(
        open_store(store),
        preset,
        overrides=parse_assignments(list(assignments)),
        name=name,
        round=round,
        snapshot=snapshot,
    )
    seconds = time.perf_counter() - started
    if json:
        console.print_json(printing.selection_json(selection))
    else:
        printing.print_selection(selection, store)
        where = shlex.quote(store)
        console.say(f"selected in {seconds:.2f} s; next: tcrdata evaluate --store {where}")
    return 0
