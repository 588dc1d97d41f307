"""Pictures of a store's frames: what was selected, what was not, and the truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import tcrdata
from tcrdata import registry
from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.ingest import frames_of
from tcrdata.plan import ROUND
from tcrdata.reports import run_report
from tcrdata.store import Store
from tcrdata.store.arrays import decode_flow, decode_points
from tcrdata.types import BOX_COLUMNS, FloatArray, Frame

FRAMES_BY_DEFAULT = 5


def draw_frames(
    store: Store,
    selection_id: str,
    out: Path,
    sequence: str | None,
    frames: str | None,
    *,
    with_truth: bool,
) -> Iterator[Path]:
    """Draw frames of a sequence into PNG files; yield each file's path as it is written.

    Args:
        store: what to draw from; its dataset must still be where the build read it.
        selection_id: whose labels to draw.
        out: folder that is there.
        sequence: the first of the store when None.
        frames: ranges; five spread over the sequence when None.
        with_truth: draw ground truth too.

    Raises:
        MissingEvidenceError: the store has no such sequence or frame.
    """
    from tcrdata.views.scene_picture import frame_picture

    info = sequence_row(store, sequence)
    dataset = registry.find("datasets", info["dataset"]).open_dataset(info["root"])
    handle = tcrdata.open(store.url)
    for frame in _chosen(store, info, frames):
        boxes = _boxes(handle.connection, selection_id, frame, with_truth=with_truth)
        picture = frame_picture(
            dataset.read_image(frame) if frame.has_image else None,
            dataset.read_points(frame).xyz,
            read_votes(store, frame),
            boxes,
            frame.level_projection,
            info["metric_scale"],
            f"{frame.dataset} {frame.sequence}, frame {frame.frame}",
        )
        path = out / f"{frame.sequence}-{frame.frame:06d}.png"
        path.write_bytes(picture)
        yield path
        yield from _flow_file(store, frame, out)
    yield from _track_file(store, handle.connection, selection_id, info, out)


def sequence_row(store: Store, sequence: str | None) -> dict[str, Any]:
    """Return the row of `sequences` of this name, or the first.

    Raises:
        MissingEvidenceError: the store has no such sequence; says which it has.
    """
    rows = store.read("sequences").to_pylist()
    for row in rows:
        if sequence in (None, row["sequence"]):
            return dict(row)
    names = ", ".join(row["sequence"] for row in rows[:8]) or "none"
    raise MissingEvidenceError(f"{store.url}: no sequence '{sequence}'; there are: {names}")


def _chosen(store: Store, info: dict[str, Any], text: str | None) -> list[Frame]:
    frames = list(frames_of(store, info["dataset"], info["sequence"]))
    if text is None:
        spread = np.linspace(0, len(frames) - 1, min(FRAMES_BY_DEFAULT, len(frames)))
        return [frames[int(index)] for index in spread.round()]
    ranges = parse_frame_ranges(text)
    chosen = [frame for frame in frames if frame.frame in ranges]
    if not chosen:
        raise SettingsError(f"--frames {text}: {info['sequence']} has no such usable frame")
    return chosen


def _boxes(
    connection: Any, selection_id: str, frame: Frame, *, with_truth: bool
) -> dict[str, FloatArray]:
    parameters = {
        "selection_id": selection_id,
        "pictured_dataset": frame.dataset,
        "pictured_sequence": frame.sequence,
        "pictured_frames": [frame.frame],
    }
    rows = run_report(connection, "picture_boxes", parameters).to_arrow_table().to_pylist()
    kinds = {"labels", *(row["kind"] for row in rows)} - (set() if with_truth else {"truth"})
    return {
        kind: np.array(
            [[row[name] for name in BOX_COLUMNS] for row in rows if row["kind"] == kind]
        ).reshape(-1, 7)
        for kind in sorted(kinds)
    }


def read_votes(store: Store, frame: Frame) -> Any:
    """The frame's free-space votes, or None when no build has measured them."""
    from tcrdata.views.birds_eye import Votes

    found = {}
    for cue in ("votes_free", "votes_static"):
        rows = store.read(
            "point_evidence",
            dataset=frame.dataset,
            sequence=frame.sequence,
            round=ROUND,
            frame=frame.frame,
            cue=cue,
        ).to_pylist()
        if not rows:
            return None
        row = rows[0]
        found[cue] = decode_points(row["codec"], row["data"], row["number_of_points"])
    return Votes(found["votes_free"], found["votes_static"])


def _track_file(
    store: Store, connection: Any, selection_id: str, info: dict[str, Any], out: Path
) -> Iterator[Path]:
    """Write the path of the camera and of each selected track, seen from above."""
    from tcrdata.evidence.poses import read_poses
    from tcrdata.views.track_picture import track_picture

    poses = read_poses(store.tables(info["dataset"], info["sequence"], ROUND))
    frames = sorted(poses.world_T_level)
    places = {frame: place for place, frame in enumerate(frames)}
    parameters = {
        "selection_id": selection_id,
        "pictured_dataset": info["dataset"],
        "pictured_sequence": info["sequence"],
    }
    tracks: dict[str, list[tuple[int, list[float]]]] = {}
    for row in run_report(connection, "picture_boxes", parameters).to_arrow_table().to_pylist():
        if row["kind"] == "labels" and row["track_id"] and row["frame"] in places:
            box = [row[name] for name in BOX_COLUMNS]
            name = row["track_id"].rpartition("/")[2]
            tracks.setdefault(name, []).append((places[row["frame"]], box))
    if not tracks:
        return
    picture = track_picture(
        np.array([poses.world_T_level[frame] for frame in frames]),
        {
            name: (np.array([place for place, _ in found]), np.array([box for _, box in found]))
            for name, found in tracks.items()
        },
        f"{info['dataset']} {info['sequence']}: the camera's path and the selected tracks",
    )
    path = out / f"{info['sequence']}-tracks.png"
    path.write_bytes(picture)
    yield path


def _flow_file(store: Store, frame: Frame, out: Path) -> Iterator[Path]:
    """Write the forward flow by the colour wheel, when a build has measured it."""
    from tcrdata.views.canvas import png_bytes
    from tcrdata.views.flow_colours import flow_picture

    rows = store.read(
        "flows",
        dataset=frame.dataset,
        sequence=frame.sequence,
        round=ROUND,
        frame=frame.frame,
        direction="forward",
    ).to_pylist()
    for row in rows[:1]:
        flow = decode_flow(row["codec"], row["data"], row["height_px"], row["width_px"])
        path = out / f"{frame.sequence}-{frame.frame:06d}-flow.png"
        path.write_bytes(png_bytes(flow_picture(flow)))
        yield path
