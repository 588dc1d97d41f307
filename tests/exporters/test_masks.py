"""Masks of labels whose proposals have none: the hull of their points, worked out by hand."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_worlds import drive
from label_worlds import box, label_row
from pycocotools.coco import COCO

from tcrdata.errors import FrameError
from tcrdata.exporters import masks
from tcrdata.exporters.coco import export
from tcrdata.exporters.labels import ExportOptions, SequenceLabels

# 0.2 m apart at 10 m: 14 px with a focal length of 700 px, around column 600 and row 180 + 70.
SQUARE = [[x, y, 10.0] for x in (-0.1, 0.1) for y in (0.9, 1.1)]
POINTS = np.array([*SQUARE, [0.0, 1.0, 10.0], [0.0, 1.0, -10.0], [90.0, 1.0, 10.0]])


class OnePlace:
    """The same points in every frame."""

    def __init__(self, part: SequenceLabels) -> None:
        self.part = part

    def level(self, row: int) -> Any:
        return POINTS + 0.0 * row


def proposal(name: str, points: list[int] | None, mask: str | None = None) -> dict[str, Any]:
    place = box(0.0, 10.0)
    del place["left_px"]
    return {
        "sequence": "0000", "proposal_id": name, "frame": 0, "source": "track", "fit": "track",
        "region_id": name, "found": "observed", "metric_scale": 1.0, "range_m": 10.0,
        "number_of_points": 5, "mask": mask, "point_indices": points, **place,
    }  # fmt: skip


def exported(tmp_path: Path, *proposals: dict[str, Any], labels_only: bool = False) -> COCO:
    labels = [label_row("0000", 0, p["proposal_id"], 0.9, **box(0, 10)) for p in proposals]
    store = drive(tmp_path, labels, proposals=list(proposals))
    export(store, "s1", tmp_path / "out", ExportOptions(labels_only=labels_only))
    with contextlib.redirect_stdout(io.StringIO()):
        return COCO(str(tmp_path / "out" / "annotations" / "instances.json"))


@pytest.fixture(autouse=True)
def points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(masks, "FramePoints", OnePlace)


def test_points_become_their_hull(tmp_path: Path) -> None:
    (annotation,) = (coco := exported(tmp_path, proposal("p", [0, 1, 2, 3, 4, 5, 6]))).anns.values()
    pixels = coco.annToMask(annotation)
    assert pixels.shape == (360, 1200)
    # Behind the camera and outside the image a point counts for nothing.
    assert pixels[243:258, 593:608].all()
    assert pixels.sum() == annotation["area"] == 15 * 15


def test_labels_without_pixels_have_no_mask(tmp_path: Path) -> None:
    coco = exported(tmp_path, proposal("none", None), proposal("behind", [5, 6]))
    assert ["segmentation" in a for a in coco.anns.values()] == [False, False]


def test_labels_alone_read_no_points(tmp_path: Path) -> None:
    coco = exported(tmp_path, proposal("p", [0, 1, 2, 3]), labels_only=True)
    assert ["segmentation" in a for a in coco.anns.values()] == [False]


def test_points_that_changed_since_the_build(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match="others than the build saw"):
        exported(tmp_path, proposal("p", [0, 7]))
