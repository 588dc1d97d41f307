"""`tcrdata status`: what a store holds and lacks."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.frame_ranges import spans


def status(*, store: StoreUrl, json: Flag = False) -> int:
    """List units done, failed and missing, frames left out, and rows and bytes a table.

    Args:
        store: folder or URL of the store.
        json: print as JSON.
    """
    from tcrdata.status import store_status
    from tcrdata.store import open_store

    found = store_status(open_store(store))
    if json:
        console.print_json(found.as_dict())
        return 0
    console.print_table(
        "units", ("done", "failed", "missing"), [(found.done, found.failed, found.missing)]
    )
    if len(found.rounds) > 1:
        columns = ("round", "models", "done", "failed", "missing")
        console.print_table("rounds", columns, found.rounds)
    console.print_table("tables", ("table", "rows", "bytes", "files"), found.tables)
    if found.problems:
        console.print_table("problems", ("where", "frame", "what"), _merged(found.problems))
    if found.selections:
        console.print_table("selections", ("id", "name", "labels", "round"), found.selections)
    if found.missing:
        console.say("run the same build again to make what is missing")
    return 0


def _merged(problems: list[tuple[str, int | None, str]]) -> list[tuple[str, str | None, str]]:
    """Return a line for what is wrong with frames next to each other."""
    rows: list[tuple[str, str | None, str]] = []
    for where, found in groupby(problems, itemgetter(0)):
        listed = list(found)
        rows += [(where, None, what) for _, frame, what in listed if frame is None]
        frames = [(frame, what) for _, frame, what in listed if frame is not None]
        rows += [(where, *span) for span in spans(frames)]
    return rows
