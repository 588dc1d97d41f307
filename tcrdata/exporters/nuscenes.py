"""nuScenes tables: `v1.0-trainval/*.json`, with the images and points that they name.

Thirteen tables that refer to one another by tokens, as the nuScenes schema has them
(docs/schema_nuscenes.md of nuscenes-devkit). Boxes: geometric centre in the global frame, width,
length, height, and a quaternion, w first. A token is the md5 of what it stands for.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from tcrdata.errors import MissingEvidenceError
from tcrdata.exporters.global_frames import global_boxes, quaternions
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.nuscenes_drives import Drive, Sensors
from tcrdata.exporters.nuscenes_tables import (
    IGNORE,
    TABLES,
    Tables,
    attribute_names,
    open_tables,
    token,
    write_fixed,
    write_map,
)
from tcrdata.exporters.refusals import check_name
from tcrdata.reports import run_report
from tcrdata.store import Store

VERSION = "v1.0-trainval"
"""Name of the folder of tables: one of those that readers of nuScenes ask for."""

_CATEGORIES = {
    "Car": "vehicle.car",
    "Van": "vehicle.car",
    "Truck": "vehicle.truck",
    "Pedestrian": "human.pedestrian.adult",
    "Person": "human.pedestrian.adult",
    "Cyclist": "vehicle.bicycle",
}


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write the tables of every drive: each frame a sample, samples without labels too.

    Args:
        store: holds the selection and egomotions, unless no camera moves; its dataset must still
            be where the build read it, unless `labels_only`.
        selection_id: of the labels.
        out: folder that gets `v1.0-trainval/`, `samples/` and `maps/`.
        options: which labels, and how; a category of KITTI becomes nuScenes' own.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, no positive label, or no egomotion.
        FrameError: an image or a sweep is gone since the build.
    """
    options = options or ExportOptions()
    category = _CATEGORIES.get(options.category, options.category)
    with chosen_labels(store, selection_id, options) as chosen:
        alone = _check_egomotions(chosen, options)
        folder = open_folder(out, options.overwrite)
        (folder / VERSION).mkdir(exist_ok=True)
        sensors = Sensors(None if options.labels_only else folder)
        with open_tables(folder / VERSION) as tables:
            write_fixed(tables, category, bool(chosen.ignored))
            logs = _write_drives(chosen, tables, sensors, category)
            write_map(folder, logs, tables)
    files = len(TABLES) + 1 + sensors.files
    scenes = (
        f"{tables['scene'].count}, each of frames that egomotion links; {alone} drives have none"
    )
    return _card(str(out), options, chosen, files, scenes, category)


def _check_egomotions(chosen: ChosenLabels, options: ExportOptions) -> int:
    """Return how many drives have no egomotion: each of their frames is a scene alone.

    Raises:
        MissingEvidenceError: no drive has any.
    """
    parameters = {"exported_dataset": options.dataset}
    drives = run_report(chosen.connection, "exported_egomotions", parameters).fetchall()
    alone = sum(not linked for _, _, _, linked in drives)
    if alone == len(drives):
        raise MissingEvidenceError(
            "nuScenes' boxes stand in a global frame, and the selection read no egomotion: build "
            "and select with a preset that measures it (tcrdata build --preset tcrdata)"
        )
    return alone


def _write_drives(
    chosen: ChosenLabels, tables: Tables, sensors: Sensors, category: str
) -> list[str]:
    """Write every sequence; returns the tokens of their logs."""
    owners: dict[str, str] = {}
    logs = []
    for part in chosen.sequences("exported_scenes"):
        check_name(owners, part)
        drive = Drive(part)
        logs.append(drive.write(tables, sensors))
        tables["instance"].extend(_instances(drive, category))
        tables["sample_annotation"].extend(_annotations(drive, category))
    return logs


def _instances(drive: Drive, category: str) -> Iterator[dict[str, Any]]:
    """Yield each track of each scene once: at its first label."""
    names = ("proposal_id", "first_id", "last_id", "annotations")
    rows = zip(*(drive.links[name].to_pylist() for name in names), strict=True)
    for (own, first, last, count), positive in zip(rows, drive.part.positive, strict=True):
        if own == first:
            yield {
                "token": token("instance", first),
                "category_token": token("category", category if positive else IGNORE),
                "nbr_annotations": count,
                "first_annotation_token": token("sample_annotation", first),
                "last_annotation_token": token("sample_annotation", last),
            }


def _annotations(drive: Drive, category: str) -> Iterator[dict[str, Any]]:
    part = drive.part
    centers, axes = global_boxes(part.boxes, drive.global_T_ego[part.frame_rows])
    turns = quaternions(axes).tolist() if len(axes) else []
    sizes = part.boxes[:, [4, 3, 5]].tolist()
    places = centers.tolist()
    names = ("proposal_id", "previous_id", "next_id", "first_id", "visibility", "moving")
    links = zip(*(drive.links[name].to_pylist() for name in names), strict=True)
    points = part.labels["number_of_points"].to_pylist()
    frames = part.frame_rows.tolist()
    attributes = [token("attribute", name) for name in attribute_names(category) or ()]
    # A label is named by its neighbours, too, and an instance by each of its labels.
    tokens = _tokens("sample_annotation", drive.links["proposal_id"])
    instances = _tokens("instance", drive.links["first_id"])
    for row, (own, before, after, first, visibility, moving) in enumerate(links):
        known = bool(attributes) and moving is not None
        yield {
            "token": tokens[own],
            "sample_token": drive.samples[frames[row]],
            "instance_token": instances[first],
            "attribute_tokens": [attributes[not moving]] if known else [],
            "visibility_token": "" if visibility is None else str(visibility),
            "translation": places[row],
            "size": sizes[row],
            "rotation": turns[row],
            "num_lidar_pts": points[row] or 0,
            "num_radar_pts": 0,
            "prev": tokens[before] if before else "",
            "next": tokens[after] if after else "",
        }


def _tokens(kind: str, names: pa.ChunkedArray) -> dict[str, str]:
    """Return the token of each of several things."""
    return {name: token(kind, name) for name in names.unique().to_pylist()}


def _card(
    out: str, options: ExportOptions, chosen: ChosenLabels, files: int, scenes: str, category: str
) -> Card:
    kept = f"category {IGNORE}, which no detection class stands for"
    made = "images are links or PNGs; points are x y z intensity ring, five float32 each"
    conventions = (
        ("file", f"{VERSION}/*.json: {len(TABLES)} tables; samples/ and maps/ beside them"),
        ("scenes", scenes),
        ("samples", "every frame is a key frame" + ("" if options.labels_only else f"; {made}")),
        ("frame", "global: x forward, y left, z up, the camera's place in a scene's first frame"),
        ("ego", "the camera's place, z up along gravity (not the rear axle on the ground)"),
        ("centre", "geometric centre of the box"),
        ("order", "size is width length height; rotation is w x y z"),
        ("yaw", "about z (up): 0 along x, pi/2 along y; rotation is exact where the ego tilts"),
        ("units", "metres, microseconds; intensity 0 to 255"),
        ("category", f"{category} for every label: the labels have no class"),
        ("ignore", kept if options.ignore == "keep" else "dropped"),
    )
    return Card("nuscenes", out, files, chosen.total, chosen.ignored, conventions)
