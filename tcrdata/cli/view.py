"""`tcrdata view`: a recording to look at in Rerun."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected


def view(
    *,
    store: StoreUrl,
    out: str,
    sequence: str | None = None,
    selection: str | None = None,
    frames: str | None = None,
    truth: bool = True,
    json: Flag = False,
) -> int:
    """Record a sequence for the Rerun viewer: images, points coloured by votes, boxes, tracks.

    Needs the extra `viz`: pip install 'tcrdata[viz]'.

    Args:
        store: folder or URL of the store.
        out: `.rrd` file to write.
        sequence: the first when left out.
        selection: name or id; the newest when left out.
        frames: `0-49`; all when left out.
        truth: show ground truth too, where there is any.
        json: print JSON.
    """
    from tcrdata.recordings import record_sequence
    from tcrdata.store import open_store

    opened = open_store(store)
    chosen = selected(opened, selection)
    path = Path(out)
    written = list(record_sequence(opened, chosen, path, sequence, frames, with_truth=truth))
    size = path.stat().st_size
    if json:
        console.print_json(
            {"file": out, "selection_id": chosen, "frames": len(written), "bytes": size}
        )
    else:
        sys.stdout.write(f"{out}\n")
    console.say(f"{len(written)} frames, {size / 1e6:.1f} MB; next: rerun {shlex.quote(out)}")
    return 0
