"""`tcrdata why`: what the rules say of one proposal."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.errors import SettingsError

if TYPE_CHECKING:
    from tcrdata.inspection.why import Explanation


def why(
    proposal: str | None = None,
    /,
    *,
    store: StoreUrl,
    selection: str | None = None,
    frame: int | None = None,
    at: str | None = None,
    sequence: str | None = None,
    preset: str | None = None,
    png: str | None = None,
    json: Flag = False,
) -> int:
    """Say why a proposal is a label or none: each rule's value, bound, margin and verdict.

    Args:
        proposal: id of the proposal; or point at it with --frame and --at.
        store: folder or URL of the store.
        selection: name or id; the newest when left out.
        frame: number of the frame to point into.
        at: place to point at, X,Z in metres: x to the right, z ahead; write --at=-2,8 for x < 0.
        sequence: drive to point into; may be left out when there is one.
        preset: path of the selection's preset when it is your own: gives units and sources.
        png: draw the image, the bird's-eye view and the margins into this file.
        json: print as JSON.
    """
    from tcrdata.inspection.drives import Drives
    from tcrdata.inspection.finding import find_by_id, find_by_place
    from tcrdata.inspection.why import explain
    from tcrdata.store import open_store

    opened = open_store(store)
    pointed = frame is not None and at is not None
    if (proposal is None) is not pointed or (proposal and (frame is not None or at is not None)):
        raise SettingsError("name a proposal by its id, or point at one: --frame F --at X,Z")
    chosen = selected(opened, selection)
    drives = Drives(opened)
    row = drives.selection(chosen)
    if proposal is not None:
        found = find_by_id(drives, row, proposal)
    else:
        found = find_by_place(drives, row, sequence, frame or 0, at or "")
    explanation = explain(row, found, preset)
    if png is not None:
        from tcrdata.inspection.why_pictures import draw_why

        try:
            Path(png).write_bytes(draw_why(opened, explanation))
        except OSError as error:
            raise SettingsError(f"--png {png}: {error.strerror}: give another file") from error
    if json:
        console.print_json(explanation.to_json())
    else:
        _print(explanation)
    if png is not None:
        console.say(f"drawn: {png}")
    console.say(f"next: {_next(explanation, store, preset, drawn=png is not None)}")
    return 0


def _print(found: Explanation) -> None:
    """Everything as tables, the answer first."""
    for line in _answer(found):
        sys.stdout.write(line + "\n")
    console.print_table(
        "rules",
        ("rule", "verdict", "value", "margin", "needs", "source"),
        [
            (
                r.rule + " *" * r.required, r.verdict, _number(r.value), _margin(r.margin),
                r.needs, _where(r.source),
            )
            for r in found.rules
        ],
    )  # fmt: skip
    if any(rule.required for rule in found.rules):
        sys.stdout.write("* required: abstaining stops the proposal\n")
    console.print_table(
        "evidence",
        ("about", "what", "value", "unit", "confidence"),
        [
            (row["about"], row["name"], _number(row["value"]), row["unit"], row["confidence"])
            for row in found.evidence
        ],
    )
    columns = ("what", "source", "became", "proposals", "frames", "such as")
    if found.relations:
        rows = [(r["relation"], f"{r['source']} {r['fit']}", *_became(r)) for r in found.relations]
        console.print_table("its region, track and place, in this selection", columns, rows)
    if found.others:
        rows = [(r["selection"], r["selection_id"][:12], _outcome(r)) for r in found.others]
        console.print_table("other selections", ("name", "id", "became"), rows)


def _answer(found: Explanation) -> list[str]:
    """What it is, what became of it, and which rule decides."""
    p = found.proposal
    lines = []
    if found.nearest:
        first, *rest = found.nearest
        lines.append(
            f"nearest: {first['proposal_id']}, {first['distance_m']:.2f} m from the place"
            + "; then " * bool(rest)
            + ", ".join(f"{r['proposal_id']} ({r['distance_m']:.2f} m)" for r in rest[:2])
        )
    lines.append(
        f"{p['proposal_id']}: {p['length_m']:.1f} x {p['width_m']:.1f} x {p['height_m']:.1f} m at "
        f"x {p['x_m']:.1f}, z {p['z_m']:.1f} m, {p['range_m']:.1f} m away, "
        f"{p['number_of_points']} points, {p['found']}"
    )
    because = {"loosened": "the loosened bounds accept it", None: ""}.get(
        found.ignored_because, f"preset {found.ignored_because} accepts it"
    )
    lines.append(
        f"selection {found.selection_id[:12]} '{found.selection}': {found.outcome}"
        + (f" ({because})" if because else "")
        + (f", score {p['score']:.2f}" if p["score"] is not None else "")
    )
    stopping = [rule for rule in found.rules if rule.stops]
    for rule in stopping:
        alone = " alone" * rule.alone
        change = f"; {rule.change} would let it pass" if rule.change else ""
        lines.append(f"stopped by {rule.rule}{alone}: {rule.says}{change}")
    for rule in found.rules:
        if rule.tightest:
            lines.append(f"every rule lets it pass; tightest: {rule.says}")
    if found.outcome == "left out":
        lines.append(
            f"the select of preset {found.preset} does not take it: see what stands in its place"
        )
    return lines


def _number(value: float | None) -> str:
    """A value with the digits that matter."""
    from tcrdata.inspection.sentences import number

    return "-" if value is None else number(value)


def _margin(value: float | None) -> str:
    """A margin in bounds, with its sign."""
    return "-" if value is None else f"{value:+.3g}"


def _where(source: str) -> str:
    """The place in the literature alone; `tcrdata rules` tells the rest."""
    return re.split("[:;] ", source)[0]


def _became(row: dict[str, Any]) -> tuple[Any, ...]:
    frames = f"{row['first_frame']}-{row['last_frame']}"
    if row["first_frame"] == row["last_frame"]:
        frames = str(row["first_frame"])
    return _outcome(row), row["proposals"], frames, row["proposal_id"]


def _outcome(row: dict[str, Any]) -> str:
    """An outcome with what brought it about."""
    because = f" ({row['ignored_because']})" if row["ignored_because"] else ""
    stopped = f" by {', '.join(row['stopped_by'])}" if row["stopped_by"] else ""
    return f"{row['outcome']}{because}{stopped if row['outcome'] == 'rejected' else ''}"


def _next(found: Explanation, store: str, preset: str | None, *, drawn: bool) -> str:
    """The command that would accept it, else one that shows more."""
    where = f"--store {shlex.quote(store)}"
    if found.changes:
        changed = {change.partition("=")[0] for change in found.changes}
        kept = [value for value in found.parameters if value.partition("=")[0] not in changed]
        values = " ".join(f"--set {shlex.quote(value)}" for value in (*kept, *found.changes))
        name = shlex.quote(preset or found.preset)
        heard = f" --round {found.round}" if found.round > 1 else ""
        return f"tcrdata check {where} --preset {name}{heard} {values} --name changed"
    p = found.proposal
    if not drawn:
        return (
            f"tcrdata why {p['proposal_id']} {where} --selection {found.selection_id} --png why.png"
        )
    return (
        f"tcrdata draw {where} --selection {found.selection_id} --sequence {p['sequence']} "
        f"--frames {p['frame']} --out pictures"
    )
