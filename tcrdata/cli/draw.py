"""`tcrdata draw`: pictures of frames."""

from __future__ import annotations

import sys
from pathlib import Path

from tcrdata.cli.app import StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.errors import SettingsError


def draw(
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    sequence: str | None = None,
    frames: str | None = None,
    truth: bool = True,
) -> int:
    """Draw frames: the image with boxes beside the bird's-eye view coloured by free-space votes.

    Args:
        store: folder or URL of the store.
        out: folder for the PNG files.
        selection: name or id; the newest when left out.
        sequence: the first when left out.
        frames: `0,10,20`; five spread over the sequence when left out.
        truth: draw ground truth too, where there is any.
    """
    from tcrdata.pictures import draw_frames
    from tcrdata.store import open_store

    opened = open_store(store)
    chosen = selected(opened, selection)
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"--out {out}: {error.strerror}: give another folder") from error
    for path in draw_frames(opened, chosen, folder, sequence, frames, with_truth=truth):
        sys.stdout.write(f"{path}\n")
    return 0
