"""Generated frames kept in memory: drives that many builds of one module read are cast once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from tcrdata.datasets.street import StreetDrive
from tcrdata.types import Frame, ImageArray, PointCloud


@contextmanager
def kept_frames() -> Iterator[None]:
    """Let a street's sweeps and images be made once; each reader gets copies of its own."""
    clouds: dict[Any, PointCloud] = {}
    images: dict[Any, ImageArray] = {}
    cast, render = StreetDrive.read_points, StreetDrive.read_image

    def read_points(drive: StreetDrive, frame: Frame) -> PointCloud:
        key = (drive.spec, frame.frame)
        if key not in clouds:
            clouds[key] = cast(drive, frame)
        return PointCloud(clouds[key].xyz.copy(), clouds[key].reflectance.copy())

    def read_image(drive: StreetDrive, frame: Frame) -> ImageArray:
        key = (drive.spec, frame.frame)
        if key not in images:
            images[key] = render(drive, frame)
        return np.copy(images[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StreetDrive, "read_points", read_points)
        patch.setattr(StreetDrive, "read_image", read_image)
        yield
