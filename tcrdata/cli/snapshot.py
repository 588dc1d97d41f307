"""`tcrdata snapshot`: what a store holds at this moment, frozen under a name."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl

if TYPE_CHECKING:
    from tcrdata.store import Snapshot, Store


def snapshot(name: str | None = None, /, *, store: StoreUrl, json: Flag = False) -> int:
    """Freeze the files of this moment under a name; without a name, list the snapshots.

    A snapshot is a list of files: it costs no copy, and what lands in the store later is not in
    it. `build`, `check`, `export` and `train` read it with `--snapshot NAME`.

    Args:
        name: of letters, digits, '.', '_' and '-'; a name that is taken by other files is refused.
        store: folder or URL of the store.
        json: print as JSON.
    """
    from tcrdata.store import open_store

    opened = open_store(store)
    if name is None:
        return _list(opened, json=json)
    frozen = opened.freeze(name)
    tables = _tables(frozen)
    if json:
        console.print_json({"name": frozen.name, "tables": tables})
    else:
        heads = ("table", "rows", "bytes", "files")
        rows = [(table, *counts.values()) for table, counts in tables.items() if counts["files"]]
        console.print_table(f"snapshot {frozen.name}", heads, rows)
    console.say(f"next: tcrdata check --store {shlex.quote(store)} --snapshot {frozen.name}")
    return 0


def _list(store: Store, *, json: bool) -> int:
    """Every snapshot with its size, and the selections that were made from it."""
    selections = store.read("selections", columns=["snapshot", "name"]).to_pylist()
    rows: list[dict[str, Any]] = []
    for name in store.snapshots():
        tables = _tables(store.snapshot(name))
        made = sorted({row["name"] for row in selections if row["snapshot"] == name})
        totals = {
            key: sum(counts[key] for counts in tables.values())
            for key in ("files", "rows", "bytes")
        }
        rows.append({"name": name, "tables": len(tables), **totals, "selections": made})
    if json:
        console.print_json(rows)
    else:
        heads = ("snapshot", "tables", "files", "rows", "bytes", "selections made from it")
        listed = [(*list(row.values())[:-1], ", ".join(row["selections"])) for row in rows]
        console.print_table("", heads, listed)
    console.say(f"next: tcrdata snapshot NAME --store {shlex.quote(store.url)}")
    return 0


def _tables(frozen: Snapshot) -> dict[str, dict[str, int]]:
    """Rows, bytes and files of each table that a snapshot covers."""
    found = {table: {"rows": 0, "bytes": 0, "files": 0} for table in frozen.tables}
    for entry in frozen.files:
        counts = found[entry.table]
        counts["rows"] += entry.rows
        counts["bytes"] += entry.bytes
        counts["files"] += 1
    return found
