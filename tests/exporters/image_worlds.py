"""A drive of three frames with images on disk, its labels chosen by the test."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from label_worlds import box, frame_row, label_row, make_store, sequence_row
from PIL import Image

from tcrdata.store import Store

FRAMES = 3
BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
BOX_2D = ("left_px", "top_px", "right_px", "bottom_px")
PIXELS = {"left_px": 100.0, "top_px": 50.5, "right_px": 200.0, "bottom_px": 150.0}
_numbers = count()


def drive(
    root: Path,
    labels: list[dict[str, Any]],
    *,
    sequences: tuple[str, ...] = ("0000",),
    images: bool = True,
    static: bool = False,
    **tables: list[dict[str, Any]],
) -> Store:
    """A store whose images lie in `root/<sequence>/<frame>.png`.

    Args:
        root: where the images are put.
        labels: rows of `labels`.
        sequences: each of three frames.
        images: whether there are any.
        static: the camera does not move.
        tables: rows of further tables, such as `egomotions` and `proposals`.
    """
    places = [(sequence, frame) for sequence in sequences for frame in range(FRAMES)]
    for sequence, frame in places if images else ():
        path = root / sequence / f"{frame}.png"
        path.parent.mkdir(exist_ok=True, parents=True)
        Image.fromarray(np.full((4, 12, 3), 40 * frame, np.uint8)).save(path)
    return make_store(
        f"images{next(_numbers)}",
        sequences=[
            sequence_row(name) | {"root": str(root), "static_camera": static} for name in sequences
        ],
        frames=[frame_row(s, f) | {"has_image": images} for s, f in places],
        images=[
            {"sequence": s, "frame": f, "image": {"bytes": None, "path": f"{s}/{f}.png"}}
            for s, f in (places if images else ())
        ],
        labels=labels,
        **tables,
    )


def random_labels(number: int) -> list[dict[str, Any]]:
    """Labels in frames 0 and 1 of sequence 0000; frame 2 stays empty. Every fourth is ignored."""
    random = np.random.default_rng(5)
    return [
        label_row("0000", n % 2, f"p{n:02d}", float(random.random()), track_id=f"t{n // 2}")
        | box(float(random.uniform(-3, 3)), float(random.uniform(8, 30)))
        | {"yaw_rad": float(random.uniform(-np.pi, np.pi)), "number_of_points": n}
        | {"state": "ignore" if n % 4 == 3 else "positive"}
        for n in range(number)
    ]
