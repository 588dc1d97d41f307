"""Finds the proposal that is asked about: by its id, or by where it is."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import duckdb

from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.inspection.drives import Drives
from tcrdata.reports import report_rows

_NEAR = 3


@dataclass(frozen=True)
class Found:
    """A proposal and the connection to its drive.

    Attributes:
        proposal_id: its id.
        dataset: its dataset.
        sequence: its drive.
        drives: that it is one of.
        connection: to the drive.
        nearest: rows of `why_nearest`, the one taken first; empty when the id was given.
    """

    proposal_id: str
    dataset: str
    sequence: str
    drives: Drives
    connection: duckdb.DuckDBPyConnection
    nearest: tuple[dict[str, Any], ...] = ()


def find_by_id(drives: Drives, selection: Mapping[str, Any], proposal_id: str) -> Found:
    """Find a proposal by its id, `dataset/sequence/frame/source/number/fit`.

    Args:
        drives: of the store to look in.
        selection: row of `selections`: the proposals that it judged.
        proposal_id: the id.

    Raises:
        MissingEvidenceError: the selection judged no such proposal; names near ones.
    """
    dataset, _, rest = proposal_id.partition("/")
    sequence, slash, _ = rest.partition("/")
    if not slash:
        raise MissingEvidenceError(
            f"'{proposal_id}' is no proposal's id, which begins with dataset/sequence/: "
            + _how_to_list(drives)
        )
    if not drives.holds(selection, dataset, sequence):
        raise _no_drive(drives, selection, f"{dataset}/{sequence}")
    connection = drives.connection(selection, dataset, sequence)
    asked = report_rows(connection, "why_near_ids", {"asked_id": proposal_id})
    near = [str(name) for row in asked for name in row.values()]
    if proposal_id not in near:
        names = ", ".join(near) or "none"
        raise MissingEvidenceError(
            f"{drives.store.url}: selection '{selection['name']}' judged no proposal "
            f"'{proposal_id}'; near: {names}; {_how_to_list(drives)}"
        )
    return Found(proposal_id, dataset, sequence, drives, connection)


def find_by_place(
    drives: Drives, selection: Mapping[str, Any], sequence: str | None, frame: int, at: str
) -> Found:
    """Find the proposal of a frame that is nearest to a place on the ground.

    Proposals that the selection's rule `source` judges go first: people mean what could have become
    a label. See `queries/reports/why_nearest.sql`.

    Args:
        drives: of the store to look in.
        selection: row of `selections`: the proposals that it judged.
        sequence: drive, or dataset/drive; may be None when there is one only.
        frame: number of the frame.
        at: x and z in metres, level frame, with a comma between.

    Raises:
        SettingsError: `at` is no place, or several drives are meant.
        MissingEvidenceError: no such drive, or the frame has no proposal.
    """
    x, z = parse_place(at)
    place = _drive_named(drives, selection, sequence)
    connection = drives.connection(selection, *place)
    drives.judge(connection, [selection], place, frame)
    parameters = {
        "selection_id": selection["selection_id"],
        "asked_frame": frame,
        "asked_x_m": x,
        "asked_z_m": z,
    }
    rows = report_rows(connection, "why_nearest", parameters)
    if not rows:
        first, last = connection.execute("select min(frame), max(frame) from proposals").fetchall()[
            0
        ]
        raise MissingEvidenceError(
            f"{drives.store.url}: frame {frame} of {'/'.join(place)} has no proposal; "
            f"there are some in frames {first} to {last}"
        )
    return Found(rows[0]["proposal_id"], *place, drives, connection, tuple(rows))


def parse_place(text: str) -> tuple[float, float]:
    """Return x and z of a text such as `3.5,12`.

    Raises:
        SettingsError: it is none.
    """
    parts = text.split(",")
    try:
        x, z = (float(part) for part in parts)
    except ValueError:
        x = z = float("nan")
    if not (abs(x) < float("inf") and abs(z) < float("inf")):
        raise SettingsError(
            f"--at '{text}' is no place: write X,Z in metres, x to the right and z ahead, such as "
            "--at 3.5,12 or --at=-2,8.5"
        )
    return x, z


def _drive_named(drives: Drives, selection: Mapping[str, Any], name: str | None) -> tuple[str, str]:
    """The drive that is meant."""
    meant = [d for d in drives.names(selection) if name in (None, d[1], "/".join(d))]
    if not meant:
        raise _no_drive(drives, selection, str(name))
    if len(meant) > 1:
        few = ", ".join("/".join(drive) for drive in meant[:_NEAR])
        raise SettingsError(
            f"{len(meant)} drives may be meant: name one with --sequence, such as {few}"
        )
    return meant[0]


def _no_drive(drives: Drives, selection: Mapping[str, Any], name: str) -> MissingEvidenceError:
    """An error that names the drives nearest to a name."""
    names = ["/".join(drive) for drive in drives.names(selection)]
    near = difflib.get_close_matches(name, names, n=_NEAR, cutoff=0.3) or names[:_NEAR]
    return MissingEvidenceError(
        f"{drives.store.url}: selection '{selection['name']}' judged no drive '{name}'; "
        f"near: {', '.join(near) or 'none'}"
    )


def _how_to_list(drives: Drives) -> str:
    return (
        f'list them with `tcrdata sql "select proposal_id from proposals where frame = 0" '
        f"--store {drives.store.url}`, or point: `--frame F --at X,Z`"
    )
