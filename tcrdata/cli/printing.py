"""What builds and selections look like: in lines for people, in plain values for programs."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tcrdata import console

if TYPE_CHECKING:
    from tcrdata.inspection.drift import Drift
    from tcrdata.outcomes import BuildReport
    from tcrdata.rules import Selection


def build_json(report: BuildReport, seconds: float, drifts: Sequence[Drift] = ()) -> dict[str, Any]:
    """Return a build, and what each later round changed, as plain values for JSON."""
    return {
        "seconds": round(seconds, 3),
        **{state: report.count(state) for state in ("made", "done", "failed", "skipped", "todo")},
        "units": [
            {
                "stage": o.unit.stage,
                "dataset": o.unit.dataset,
                "sequence": o.unit.sequence,
                "round": o.unit.round,
                "state": o.state,
                "seconds": round(o.seconds, 3),
                "error": o.error,
                "frames_left_out": [{"frame": f, "error": e} for f, e in o.frame_errors],
            }
            for o in report.outcomes
        ],
        "selections": [selection_json(selection) for selection in report.selections],
        "drifts": [drift.to_json() for drift in drifts],
    }


def selection_json(selection: Selection) -> dict[str, Any]:
    """Return a selection as plain values for JSON."""
    return {
        "selection_id": selection.selection_id,
        "name": selection.name,
        "preset": selection.preset,
        "round": selection.round,
        "proposals_judged": selection.proposals_judged,
        "labels": selection.labels,
        "ignored": selection.ignored,
        **({"followed": selection.followed} if selection.followed else {}),
    }


def print_build(
    report: BuildReport,
    sequences: tuple[str, ...],
    store_url: str,
    seconds: float,
    *,
    only_plan: bool,
) -> None:
    """Print what a build did, or with `only_plan` what it would do, and the next command."""
    if only_plan:
        rows = [(o.unit.sequence, o.unit.stage, o.state) for o in report.outcomes]
        console.print_table("plan", ("sequence", "stage", "state"), rows)
        for outcome in report.outcomes:
            if outcome.error:
                console.say(console.failure(outcome))
        console.say(f"{report.count('todo')} of {len(report.outcomes)} units to make")
        return
    has_images = None if all(s.labels for s in report.selections) else _has_images(store_url)
    for selection in report.selections:
        print_selection(selection, store_url, has_images=has_images)
    made, failed = report.count("made"), report.count("failed")
    skipped = report.count("skipped")
    if not made and not failed:
        console.say(f"nothing to do: all {report.count('done')} units were done already")
    else:
        console.say(
            f"{len(sequences)} sequences: {made} units made, {report.count('done')} done before, "
            f"{failed} failed, {skipped} skipped, in {seconds:.1f} s"
        )
    console.say(f"next: tcrdata status --store {shlex.quote(store_url)}")


def print_drifts(drifts: Sequence[Drift]) -> None:
    """Print what each round changed in the labels of the round before, and warn of the worse."""
    if not drifts:
        return
    columns = ("round", "labels", "kept", "moved", "gained", "lost", "agreement", "before")
    rows = [
        (d.round, d.labels, d.kept, d.moved, d.gained, d.lost, d.agreement, d.agreement_before)
        for d in drifts
    ]
    console.print_table("rounds", columns, rows)
    for drift in drifts:
        if drift.worse:
            console.say(
                f"round {drift.round} is worth a look: {drift.worse}; "
                f"see tcrdata diff {drift.round - 1} {drift.round}"
            )


def print_selection(
    selection: Selection, store_url: str, *, has_images: bool | None = None
) -> None:
    """Print a selection as one line; of one without labels say how to find out why.

    Args:
        selection: what to print.
        store_url: where it lies.
        has_images: whether a frame of the store has an image; looked up where it is asked, if None.
    """
    of_round = f" of round {selection.round}" if selection.round > 1 else ""
    sys.stdout.write(
        f"selection {selection.selection_id[:12]} '{selection.name}'{of_round}: "
        f"{selection.labels:,} labels "
        f"and {selection.ignored:,} left undecided, from {selection.proposals_judged:,} proposals\n"
    )
    if not selection.labels:
        where = f"--selection {selection.selection_id} --store {shlex.quote(store_url)}"
        seen = _has_images(store_url) if has_images is None else has_images
        blind = "" if seen else "; no frame has an image: what needs one abstains"
        console.say(f"why '{selection.name}' has no label: tcrdata funnel {where}{blind}")


def _has_images(store_url: str) -> bool:
    """Whether a frame of a store has an image."""
    from tcrdata.store import open_store

    return any(open_store(store_url).read("frames", columns=["has_image"])["has_image"].to_pylist())


def followed_line(selection: Selection, follows: str, store_url: str) -> str:
    """Return whose tracked boxes a selection was offered, or how it could be offered some."""
    if selection.followed is not None:
        return f"with the boxes tracked from selection {selection.followed[:12]}"
    return (
        f"without tracked boxes: nothing of preset {follows} was tracked in round "
        f"{selection.round}; run tcrdata track --store {shlex.quote(store_url)}"
    )
