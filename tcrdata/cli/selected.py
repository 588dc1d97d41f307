"""Which selection a command is about."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tcrdata.errors import MissingEvidenceError

if TYPE_CHECKING:
    from tcrdata.store import Store


def tracked(store: Store, name: str | None) -> str:
    """Return the id of a selection: of those that were tracked the newest, or the one named.

    Raises:
        MissingEvidenceError: there is none; says which there are.
    """
    from tcrdata.store.followed import tracked_selections

    if name is None and (newest := store.newest_selection(among=tracked_selections(store))):
        return newest
    return selected(store, name)


def selected(store: Store, name: str | None) -> str:
    """Return the id of a selection: the newest, or the one of this name or id.

    Raises:
        MissingEvidenceError: there is none; says which there are.
    """
    chosen = store.newest_selection(name)
    if chosen is None:
        known = sorted({row["name"] for row in store.read("selections").to_pylist()})
        what = f"no selection '{name}'; there are: {', '.join(known) or 'none'}"
        if name is None:
            what = "the store has no selection yet: run tcrdata check --preset tcrdata"
        raise MissingEvidenceError(f"{store.url}: {what}")
    return chosen
