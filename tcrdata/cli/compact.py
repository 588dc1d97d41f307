"""`tcrdata compact`: many small files read as few."""

from __future__ import annotations

import shlex

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl


def compact(*, store: StoreUrl, json: Flag = False) -> int:
    """Bundle the small files of many drives, so that queries over all of them are quicker.

    Nothing that is there changes; run it again when more drives have been built.

    Args:
        store: folder or URL of the store.
        json: print the bundles as JSON.
    """
    from tcrdata.store import open_store

    bundles = open_store(store).compact()
    if json:
        console.print_json([vars(bundle) for bundle in bundles])
        return 0
    tables = sorted({bundle.table for bundle in bundles})
    rows = []
    for table in tables:
        own = [bundle for bundle in bundles if bundle.table == table]
        held, size = sum(len(b.holds) for b in own), sum(b.bytes for b in own)
        rows.append((table, held, len(own), size))
    console.print_table("compacted", ("table", "files held", "bundles", "bytes"), rows)
    console.say(f"next: tcrdata funnel --store {shlex.quote(store)}")
    return 0
