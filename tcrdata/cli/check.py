"""`tcrdata check`: labels selected again from stored evidence."""

from __future__ import annotations

import shlex
import time
from typing import TYPE_CHECKING

from tcrdata import console
from tcrdata.cli import printing
from tcrdata.cli.app import Assignments, Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.errors import SettingsError
from tcrdata.settings import parse_assignments

if TYPE_CHECKING:
    from tcrdata.rules import Preset
    from tcrdata.store import Store


def check(
    *,
    store: StoreUrl,
    preset: str = "tcrdata",
    assignments: Assignments = (),
    name: str | None = None,
    selection: str | None = None,
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
        selection: name or id of the one whose tracked boxes are taken, by a preset with a line
            `-- follows:`; the newest tracked one of the preset named there when left out.
        round: EM round whose models are heard, beside what was measured once.
        snapshot: judge the evidence of this snapshot; that of this moment when left out.
        json: print the selection as JSON.
    """
    from tcrdata.rules import load_preset, select
    from tcrdata.store import open_store

    started = time.perf_counter()
    opened, loaded = open_store(store), load_preset(preset)
    chosen = select(
        opened,
        loaded,
        overrides=parse_assignments(list(assignments)),
        name=name,
        round=round,
        snapshot=snapshot,
        followed=None if selection is None else _followed(opened, loaded, selection, round),
    )
    seconds = time.perf_counter() - started
    if json:
        console.print_json(printing.selection_json(chosen))
    else:
        printing.print_selection(chosen, store)
        if loaded.follows:
            console.say(printing.followed_line(chosen, loaded.follows, store))
    where = shlex.quote(store)
    console.say(f"selected in {seconds:.2f} s; next: tcrdata evaluate --store {where}")
    return 0


def _followed(store: Store, preset: Preset, name: str, round: int) -> str:
    """Return the id of the selection whose tracked boxes a preset is to take."""
    from tcrdata.store.followed import check_followed

    if not preset.follows:
        raise SettingsError(
            f"--selection {name}: preset {preset.name} takes no tracked boxes, for its header has "
            "no line `-- follows:`; leave it out"
        )
    followed = selected(store, name)
    check_followed(store, followed, preset.follows, round)
    return followed
