"""COCO read back with pycocotools; labels score 1 against themselves."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_worlds import BOX_2D, PIXELS, drive, random_labels
from label_worlds import box, label_row
from pycocotools import mask as run_lengths
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from tcrdata.errors import FrameError, MissingEvidenceError, SettingsError, TcrdataError
from tcrdata.exporters.coco import export
from tcrdata.exporters.labels import ExportOptions

NO_PIXELS = dict.fromkeys(BOX_2D)


def load(out: Path) -> COCO:
    with contextlib.redirect_stdout(io.StringIO()):
        return COCO(str(out / "annotations" / "instances.json"))


def evaluated(coco: COCO, kind: str) -> float:
    """Average precision of the labels against themselves."""
    found = [
        {**{name: a[name] for name in ("image_id", "category_id", "bbox", "segmentation")
            if name in a}, "score": a["score"]}
        for a in coco.anns.values()
        if not a["iscrowd"]
    ]  # fmt: skip
    with contextlib.redirect_stdout(io.StringIO()):
        scoring = COCOeval(coco, coco.loadRes(found), kind)
        scoring.evaluate()
        scoring.accumulate()
        scoring.summarize()
    return float(scoring.stats[0])


def square(top: int, left: int) -> str:
    """The mask of 40 x 40 pixels of an image of 360 x 1200."""
    pixels = np.zeros((360, 1200), np.uint8, order="F")
    pixels[top : top + 40, left : left + 40] = 1
    return str(run_lengths.encode(pixels)["counts"].decode())


def proposal(name: str, frame: int, mask: str) -> dict[str, Any]:
    place = box(0.0, 10.0)
    del place["left_px"]
    return {
        "sequence": "0000", "proposal_id": name, "frame": frame, "source": "track", "fit": "track",
        "region_id": name, "found": "observed", "metric_scale": 1.0, "range_m": 10.0,
        "number_of_points": 5, "mask": mask, **place,
    }  # fmt: skip


def test_one_box_by_hand(tmp_path: Path) -> None:
    store = drive(tmp_path, [label_row("0000", 1, "p", 0.875, **(box(0, 10) | PIXELS))])
    card = export(store, "s1", tmp_path / "out", ExportOptions(category="Van"))
    coco = load(tmp_path / "out")
    (annotation,) = coco.anns.values()
    assert annotation["bbox"] == [100.0, 50.5, 100.0, 99.5]
    assert annotation["area"] == 9950.0
    assert (annotation["iscrowd"], annotation["score"]) == (0, 0.875)
    assert "segmentation" not in annotation
    image = coco.imgs[annotation["image_id"]]
    assert (image["frame"], image["width"], image["height"]) == (1, 1200, 360)
    assert [category["name"] for category in coco.cats.values()] == ["Van"]
    assert (card.labels, card.ignored, card.files) == (1, 0, 4)
    assert "left, top, width, height" in card.text()


def test_round_trip_and_empty_frames(tmp_path: Path) -> None:
    labels = random_labels(12)
    export(drive(tmp_path, labels), "s1", tmp_path / "out")
    coco = load(tmp_path / "out")
    assert [image["frame"] for image in coco.imgs.values()] == [0, 1, 2]
    assert coco.getAnnIds(imgIds=[3]) == []
    corners = {label["proposal_id"]: [label[name] for name in BOX_2D] for label in labels}
    for annotation in coco.anns.values():
        left, top, width, height = annotation["bbox"]
        expected = corners[annotation["proposal_id"]]
        assert [left, top, left + width, top + height] == pytest.approx(expected, abs=1e-4)
    assert len(coco.anns) == 12
    assert min(coco.anns) == 1  # 0 means unmatched to COCOeval


def test_labels_score_one_against_themselves(tmp_path: Path) -> None:
    labels = random_labels(12)
    proposals = [proposal(f"p{n:02d}", n % 2, square(100, 80 * n)) for n in range(12)]
    export(drive(tmp_path, labels, proposals=proposals), "s1", tmp_path / "out")
    coco = load(tmp_path / "out")
    assert evaluated(coco, "bbox") == 1.0
    assert evaluated(coco, "segm") == 1.0


def test_masks_are_the_proposals(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "p00", 0.9, **box(0, 10)),
        label_row("0000", 0, "p01", 0.8, **box(2, 10)),
    ]
    store = drive(tmp_path, labels, proposals=[proposal("p00", 0, square(100, 200))])
    export(store, "s1", tmp_path / "out")
    coco = load(tmp_path / "out")
    with_mask, without = coco.anns.values()
    pixels = coco.annToMask(with_mask)
    assert pixels.shape == (360, 1200)
    assert pixels[100:140, 200:240].all()
    assert pixels.sum() == with_mask["area"] == 1600
    assert "segmentation" not in without


def test_ignore_regions_are_crowds_or_dropped(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "p00", 0.9, **(box(0, 10) | PIXELS)),
        label_row("0000", 0, "p01", 0.8, state="ignore", **(box(2, 10) | PIXELS)),
    ]
    store = drive(tmp_path, labels)
    kept = export(store, "s1", tmp_path / "kept")
    crowd = next(a for a in load(tmp_path / "kept").anns.values() if a["iscrowd"])
    assert crowd["proposal_id"] == "p01"
    # A crowd must have a run-length mask: the box's own, 100 x about 99.5 pixels.
    assert run_lengths.area(crowd["segmentation"]) == pytest.approx(9950, rel=0.02)
    dropped = export(store, "s1", tmp_path / "dropped", ExportOptions(ignore="drop"))
    assert [a["proposal_id"] for a in load(tmp_path / "dropped").anns.values()] == ["p00"]
    assert [(c.labels, c.ignored) for c in (kept, dropped)] == [(1, 1), (1, 0)]


def test_images_are_links(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(2))
    export(store, "s1", tmp_path / "out")
    for image in load(tmp_path / "out").imgs.values():
        path = tmp_path / "out" / image["file_name"]
        assert path.is_symlink()
        assert path.read_bytes() == (tmp_path / "0000" / f"{image['frame']}.png").read_bytes()
    export(store, "s1", tmp_path / "out", ExportOptions(overwrite=True))
    export(store, "s1", tmp_path / "bare", ExportOptions(labels_only=True))
    assert not (tmp_path / "bare" / "images").exists()
    (tmp_path / "0000" / "1.png").unlink()
    with pytest.raises(FrameError, match=r"1\.png of frame 1 of '0000' cannot be read"):
        export(store, "s1", tmp_path / "gone")


def test_what_no_image_shows_is_left_out(tmp_path: Path) -> None:
    behind = box(0, 10) | NO_PIXELS | {"z_m": -10.0}
    labels = [
        label_row("0000", 0, "seen", 0.9, **box(0, 10)),
        label_row("0000", 0, "behind", 0.8, **behind),
    ]
    card = export(drive(tmp_path, labels), "s1", tmp_path / "out")
    assert len(load(tmp_path / "out").anns) == card.labels == 1
    assert "1 labels and 0 ignore regions that no image shows" in card.text()


def test_labels_that_no_image_shows_are_refused_before_a_file_is_written(tmp_path: Path) -> None:
    behind = box(0, 10) | NO_PIXELS | {"z_m": -10.0}
    labels = [
        label_row("0000", 0, "behind", 0.8, **behind),
        label_row("0000", 0, "ignored", 0.8, state="ignore", **box(0, 10)),
    ]
    with pytest.raises(MissingEvidenceError, match=r"none shows one of the 1 labels.*funnel"):
        export(drive(tmp_path, labels), "s1", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_splits_are_refused_where_there_are_none(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3))
    with pytest.raises(SettingsError, match=r"no splits.*kitti, mmdet3d, openpcdet and yolo"):
        export(store, "s1", tmp_path / "out", ExportOptions(validation=("0000",)))
    assert not (tmp_path / "out").exists()


def test_a_drive_without_images_is_refused(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3), images=False)
    with pytest.raises(MissingEvidenceError, match="coco labels images, and none of the 3 frames"):
        export(store, "s1", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_folder_that_is_not_empty(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3))
    export(store, "s1", tmp_path / "out")
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path / "out")
