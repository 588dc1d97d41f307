"""What KITTI's detection and tracking files have in common: types, fields, the DontCare line."""

from __future__ import annotations

import numpy as np

from tcrdata.errors import TcrdataError
from tcrdata.exporters.cameras import camera_boxes, camera_poses, image_boxes, observation_angle
from tcrdata.exporters.labels import SequenceLabels
from tcrdata.types import FloatArray

_CATEGORIES = ("Car", "Van", "Truck", "Pedestrian", "Cyclist", "Tram", "Misc")

DONT_CARE = "DontCare -1 -1 -10"
"""Type, truncated, occluded and alpha of a region that counts neither way."""

NO_BOX = "-1 -1 -1 -1000 -1000 -1000 -10"
"""Height, width, length, x, y, z and rotation_y of such a region."""

NO_IMAGE_BOX = -1.0
"""Each side of the 2D box of an object that no image shows."""

_LEVEL = 0.9999


def check_category(category: str, seated: str) -> None:
    """Refuse a type that readers of KITTI do not know.

    Args:
        category: the type.
        seated: what the format calls a person who sits: tracking and detection differ.

    Raises:
        TcrdataError: it is none; says which there are.
    """
    known = (*_CATEGORIES, seated)
    if category not in known:
        raise TcrdataError(f"KITTI has no type '{category}': choose one of {', '.join(known)}")


def object_numbers(part: SequenceLabels) -> FloatArray:
    """Return (N, 12) alpha, 2D box, height, width, length, x, y, z, rotation_y of all labels.

    The 2D box is NaN where no image shows the object.
    """
    camera = camera_boxes(part.boxes, camera_poses(part)[part.frame_rows])
    return np.column_stack([observation_angle(camera), image_boxes(part), camera])


def is_tilted(part: SequenceLabels) -> bool:
    """Whether a frame's camera is pitched or rolled: KITTI's boxes cannot be."""
    return bool(np.any(camera_poses(part)[:, 1, 1] < _LEVEL))


def conventions(category: str, tilted: bool) -> tuple[tuple[str, str], ...]:
    """Return the lines of the card that both formats share."""
    frame = "camera of each frame: x right, y down, z forward (KITTI: rectified camera 0)"
    if tilted:
        frame += "; it is tilted here, and this format has no pitch: centres are exact"
    return (
        ("frame", frame),
        ("centre", "bottom centre of the box"),
        ("order", "height width length, then x y z"),
        ("yaw", "rotation_y about y (down): 0 along +x, -pi/2 along +z (forward)"),
        ("alpha", "rotation_y - atan2(x, z)"),
        ("units", "metres, radians, pixels; a 2D box of -1 -1 -1 -1: no image shows it"),
        ("type", f"{category} for every object: the labels have no class"),
    )
