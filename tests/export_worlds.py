"""A store over a small KITTI drive on disk, with labels that a test chooses."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from kitti_tree import SEQUENCE, write_tracking
from label_worlds import label_row, make_store, sequence_row

from tcrdata.datasets.kitti import open_dataset
from tcrdata.store import Store

_names = count()
NAMES = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")


def kitti_store(root: Path, labels: list[dict[str, Any]], frames: int = 3) -> Store:
    """A store in memory; frames, images and sweeps are those of generated files below `root`."""
    write_tracking(root, frames=frames)
    dataset = open_dataset(str(root))
    rows, images, sweeps = [], [], []
    for frame in dataset.frames(SEQUENCE):
        assert frame.camera is not None
        key = {"sequence": SEQUENCE, "frame": frame.frame}
        rows.append(
            {
                **key,
                "timestamp_ns": frame.timestamp_ns,
                "width_px": frame.camera.width_px,
                "height_px": frame.camera.height_px,
                "projection": frame.camera.matrix.ravel().tolist(),
                "camera_T_level": np.asarray(frame.camera_T_level).ravel().tolist(),
                "level_T_sensor": frame.sensor_matrix.ravel().tolist(),
                "has_image": True,
                "status": "ok",
            }
        )
        images.append({**key, "image": {"bytes": None, "path": frame.image_path}})
        sweeps.append({**key, "path": frame.points_path})
    return make_store(
        f"export_world_{next(_names)}",
        sequences=[sequence_row(SEQUENCE) | {"root": dataset.root}],
        frames=rows,
        images=images,
        sweeps=sweeps,
        labels=labels,
    )


def random_labels(sequence: str, number: int, frames: int, seed: int = 3) -> list[dict[str, Any]]:
    """Labels with boxes anywhere ahead of the camera, any heading, without pixels."""
    random = np.random.default_rng(seed)
    low = [-6.0, 0.2, 12.0, 3.0, 1.4, 1.2, -np.pi]
    high = [6.0, 1.5, 40.0, 5.0, 2.0, 2.2, np.pi]
    return [
        label_row(sequence, n % frames, f"p{n:03d}", round(float(random.random()), 3))
        | dict(zip(NAMES, random.uniform(low, high).tolist(), strict=True))
        for n in range(number)
    ]


def boxes_of(labels: list[dict[str, Any]]) -> np.ndarray:
    """(N, 7) x, y, z, length, width, height, yaw of labels, by frame, then the surest first."""
    ordered = sorted(labels, key=lambda label: (label["frame"], -label["score"]))
    return np.array([[label[name] for name in NAMES] for label in ordered])


def assert_same_boxes(found: Any, expected: np.ndarray) -> None:
    """Boxes agree to 1e-4, headings modulo a turn."""
    difference = np.asarray(found, dtype=np.float64) - expected
    difference[:, 6] = (difference[:, 6] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(difference, 0.0, atol=1e-4)
