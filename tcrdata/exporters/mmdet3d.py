"""MMDetection3D's infos (version 2) of KITTI's folders: `kitti_infos_{train,val}.pkl`.

A pickle has `metainfo` and `data_list`; a frame has `images.CAM2`, `lidar_points` and `instances`,
whose boxes stand in the camera frame as x, y, z of the bottom centre, length, height, width, yaw.
Source: MMDetection3D's update_infos_to_v2.py, det3d_dataset.py and kitti_dataset.py.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.exporters.cameras import camera_poses, standing_boxes
from tcrdata.exporters.kitti_lines import NO_IMAGE_BOX, check_category, is_tilted, object_numbers
from tcrdata.exporters.kitti_tree import (
    FILES,
    TRAINING,
    TREE_LINES,
    lidar_to_camera,
    make_folders,
    place_images,
    place_points,
    projections,
    write_calibrations,
)
from tcrdata.exporters.labels import (
    Card,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.exporters.numbered_frames import SPLIT_LINES, numbered_frames
from tcrdata.store import Store
from tcrdata.store.table_arrays import columns
from tcrdata.types import FloatArray

_CLASSES = (
    "Pedestrian", "Cyclist", "Car", "Van", "Truck", "Person_sitting", "Tram", "Misc",
)  # fmt: skip
_IGNORED = "DontCare"
_IGNORED_LABEL = -1
_FEATURES = 4
_VERSION = "1.1"
_FILES = tuple(f"{TRAINING}/{name}" for name in FILES)


def export(
    store: Store, selection_id: str, out: str | Path, options: ExportOptions | None = None
) -> Card:
    """Write a selection's labels as infos that MMDetection3D's KittiDataset reads.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        out: folder that gets the infos, `training/`, `ImageSets/` and `frames.csv`.
        options: which labels, and how.

    Raises:
        TcrdataError: the folder is not empty, or the category is none of KITTI's.
        QueryError: the condition of `where` is none.
        SettingsError: `validation` names a sequence that is none.
        MissingEvidenceError: there is no such selection, or it has no positive labels.
        FrameError: an image or sweep of the dataset is gone.
    """
    options = options or ExportOptions()
    check_category(options.category, _CLASSES[5])
    infos: dict[str, list[dict[str, Any]]] = {"train": [], "val": []}
    tilted = False
    with chosen_labels(store, selection_id, options, splits=True) as chosen:
        folder = open_folder(out, options.overwrite)
        training = make_folders(folder, ("calib", "image_2", "velodyne"))
        with numbered_frames(folder, options, _FILES) as numbered:
            for part in chosen.sequences(files=not options.labels_only):
                names, splits = numbered.add(part)
                for split, info in zip(splits, _infos(part, names, options.category), strict=True):
                    if split:
                        infos[split].append(info)
                write_calibrations(training, part, names)
                if not options.labels_only:
                    place_images(training, part, names)
                    place_points(training, part, names)
                tilted |= is_tilted(part)
    for split, of_split in infos.items():
        content = {"metainfo": _metainfo(), "data_list": of_split}
        path = folder / f"kitti_infos_{split}.pkl"
        path.write_bytes(pickle.dumps(content, protocol=4))
    written = sum(len(info["instances"]) for of_split in infos.values() for info in of_split)
    lines = _conventions(options, tilted)
    ignored = written - chosen.total
    return Card("mmdet3d", str(out), numbered.count, chosen.total, ignored, lines)


def _metainfo() -> dict[str, Any]:
    categories = {name: number for number, name in enumerate(_CLASSES)}
    categories[_IGNORED] = _IGNORED_LABEL
    return {"categories": categories, "dataset": "kitti", "info_version": _VERSION}


def _infos(part: SequenceLabels, names: list[str], category: str) -> list[dict[str, Any]]:
    """Return the entry of every frame; frames of one camera share the lists of its matrices."""
    instances = _instances(part, category)
    transforms, cameras = lidar_to_camera(part), _square(projections(part))
    sizes = np.nan_to_num(columns(part.frames, ("width_px", "height_px"))).astype(int).tolist()
    stamps = part.frames["timestamp_ns"].to_pylist()
    infos: list[dict[str, Any]] = []
    shared: dict[bytes, tuple[Any, Any, Any]] = {}
    for row, labels in part.by_frame():
        key = transforms[row].tobytes() + cameras[row].tobytes()
        if key not in shared:
            both = cameras[row] @ transforms[row]
            shared = {key: (transforms[row].tolist(), cameras[row].tolist(), both.tolist())}
        lidar2cam, cam2img, lidar2img = shared[key]
        image = {
            "img_path": f"{names[row]}.png",
            "height": sizes[row][1],
            "width": sizes[row][0],
            "cam2img": cam2img,
            "lidar2cam": lidar2cam,
            "lidar2img": lidar2img,
        }
        points = {
            "num_pts_feats": _FEATURES,
            "lidar_path": f"{names[row]}.bin",
            "Tr_velo_to_cam": lidar2cam,
        }
        infos.append(
            {
                "sample_idx": int(names[row]),
                "timestamp": None if stamps[row] is None else stamps[row] / 1e9,
                "images": {"CAM2": image},
                "lidar_points": points,
                "instances": instances[labels],
            }
        )
    return infos


def _instances(part: SequenceLabels, category: str) -> list[dict[str, Any]]:
    """Return the instance of every label; an ignore region keeps its boxes and has label -1."""
    numbers = np.nan_to_num(object_numbers(part), nan=NO_IMAGE_BOX)
    alpha, image, camera = numbers[:, 0], numbers[:, 1:5], numbers[:, 5:]
    boxes = standing_boxes(part.boxes, camera_poses(part)[part.frame_rows])
    center = camera[:, 3:6] - np.array([0.0, 0.5, 0.0]) * camera[:, :1]
    projected = _pixels(center, projections(part)[part.frame_rows])
    truncated = np.nan_to_num(columns(part.labels, ("truncated_share",))[:, 0])
    names = ["occlusion", "difficulty", "number_of_points", "score"]
    others = part.labels.select(names).to_pylist()
    first = np.searchsorted(part.frame_rows, part.frame_rows)
    places = (np.arange(len(first)) - first).tolist()
    known = _CLASSES.index(category)
    result = []
    for row, positive in enumerate(part.positive.tolist()):
        label = known if positive else _IGNORED_LABEL
        result.append(
            {
                "bbox": image[row].tolist(),
                "bbox_label": label,
                "bbox_3d": boxes[row].tolist(),
                "bbox_label_3d": label,
                "depth": float(projected[row, 2]),
                "center_2d": projected[row, :2].tolist(),
                "num_lidar_pts": others[row]["number_of_points"] or 0,
                "difficulty": others[row]["difficulty"],
                "truncated": float(truncated[row]),
                "occluded": others[row]["occlusion"],
                "alpha": float(alpha[row]),
                "score": others[row]["score"],
                "index": places[row],
                "group_id": places[row],
            }
        )
    return result


def _pixels(points: FloatArray, projection: FloatArray) -> FloatArray:
    """Return (N, 3) column, row and depth of camera points; -1 -1 for those behind the camera."""
    found = np.einsum("nij,nj->ni", projection[:, :, :3], points) + projection[:, :, 3]
    ahead = found[:, 2:] > 0
    pixels = found[:, :2] / np.where(ahead, found[:, 2:], 1.0)
    return np.column_stack([np.where(ahead, pixels, NO_IMAGE_BOX), found[:, 2]])


def _square(projection: FloatArray) -> FloatArray:
    """Return (N, 4, 4) of (N, 3, 4): the last row 0 0 0 1."""
    last = np.broadcast_to(np.array([[0.0, 0.0, 0.0, 1.0]]), (len(projection), 1, 4))
    return np.concatenate([projection, last], axis=1)


def _conventions(options: ExportOptions, tilted: bool) -> tuple[tuple[str, str], ...]:
    category = options.category
    kept = f"bbox_label and bbox_label_3d {_IGNORED_LABEL}, with the box"
    frame = "camera of each frame: x right, y down, z forward; KittiDataset turns it to LiDAR"
    if tilted:
        frame += "; it is tilted here: boxes are exact once turned to a level LiDAR's frame"
    return (
        ("file", "kitti_infos_{train,val}.pkl: metainfo and data_list"),
        ("frame", frame),
        ("centre", "bottom centre of the box, where it stands"),
        ("order", "bbox_3d x y z, length height width, yaw"),
        ("yaw", "rotation_y about y (down): 0 along +x, -pi/2 along +z (forward)"),
        ("units", "metres, radians, pixels; a 2D box of -1 -1 -1 -1: no image shows it"),
        ("type", f"{category}, label {_CLASSES.index(category)}: the labels have no class"),
        ("ignore", kept if options.ignore == "keep" else "dropped"),
        ("config", "data_prefix=dict(pts='training/velodyne', img='training/image_2')"),
        *TREE_LINES,
        *SPLIT_LINES,
    )
