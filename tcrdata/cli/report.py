"""`tcrdata report`: one page that shows whether a selection can be trusted."""

from __future__ import annotations

import dataclasses
import shlex
import sys

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl, listed
from tcrdata.cli.selected import selected


def report(
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    sequence: str | None = None,
    json: Flag = False,
) -> int:
    """Write one self-contained HTML page about a selection.

    Funnel, scores, tracks, accepted and rejected examples with pictures, and the SQL that decided.

    Args:
        store: folder or URL of the store.
        out: the HTML file; one that is there is replaced.
        selection: name or id; the newest when left out.
        sequence: these drives alone, with commas between.
        json: print what was written as JSON.
    """
    from tcrdata.pages.report import write_report
    from tcrdata.store import open_store

    opened = open_store(store)
    chosen = selected(opened, selection)
    written = write_report(opened, chosen, out, listed(sequence))
    if json:
        console.print_json(dataclasses.asdict(written))
    else:
        sys.stdout.write(f"{written.path}\n")
    console.say(
        f"{written.bytes / 1e6:.1f} MB, {written.examples} examples, {written.pictures} with a "
        "camera image; open the page in a browser: each picture's id is one for `tcrdata why`"
    )
    console.say(f"next: tcrdata funnel --store {shlex.quote(store)} --selection {chosen}")
    return 0
