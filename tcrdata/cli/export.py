"""`tcrdata export`: labels in another program's format."""

from __future__ import annotations

import dataclasses
import sys
from typing import Annotated

from cyclopts import Parameter

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected


def export(
    format_name: Annotated[str, Parameter(name="FORMAT")],
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    overwrite: Flag = False,
    json: Flag = False,
) -> int:
    """Write a selection's labels in another program's format.

    Args:
        format_name: kitti-tracking, or the dotted path of an exporter.
        store: folder or URL of the store.
        out: folder to write into.
        selection: name or id; the newest when left out.
        overwrite: write into a folder that is not empty.
        json: print what was written as JSON.
    """
    from tcrdata import registry
    from tcrdata.store import open_store

    opened = open_store(store)
    exporter = registry.find("exporters", format_name)
    card = exporter.export(opened, selected(opened, selection), out, overwrite=overwrite)
    if json:
        console.print_json(dataclasses.asdict(card))
    else:
        sys.stdout.write(card.text() + "\n")
    return 0
