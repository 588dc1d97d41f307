"""YOLO read back as Ultralytics' documentation describes the detection format."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from image_worlds import BOX_2D, PIXELS, drive, random_labels
from label_worlds import box, label_row

from tcrdata.errors import MissingEvidenceError, SettingsError, TcrdataError
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.yolo import export


def labels_of(image: Path) -> Path:
    """The file in which readers look for the labels of an image."""
    before, after = str(image).rsplit("/images/", 1)
    return Path(f"{before}/labels/{after}").with_suffix(".txt")


def images_of(out: Path, split: str) -> list[Path]:
    """The images of a split: lines that start with ./ are relative to the list."""
    data = yaml.safe_load((out / "data.yaml").read_text())
    lines = (out / data[split]).read_text().splitlines()
    assert all(line.startswith("./images/") for line in lines)
    return [out / line[2:] for line in lines]


def corners(line: str, width: float = 1200, height: float = 360) -> list[float]:
    kind, *shares = line.split(" ")
    assert kind == "0"
    x, y, w, h = map(float, shares)
    return [(x - w / 2) * width, (y - h / 2) * height, (x + w / 2) * width, (y + h / 2) * height]


def test_one_box_by_hand(tmp_path: Path) -> None:
    store = drive(tmp_path, [label_row("0000", 1, "p", 0.9, **(box(0, 10) | PIXELS))])
    card = export(store, "s1", tmp_path / "out")
    text = (tmp_path / "out" / "labels" / "0000" / "000001.txt").read_text()
    # (100 + 200) / 2 / 1200, (50.5 + 150) / 2 / 360, 100 / 1200, 99.5 / 360
    assert text == "0 0.12500000 0.27847222 0.08333333 0.27638889\n"
    assert (card.labels, card.ignored, card.files) == (1, 0, 9)
    data = yaml.safe_load((tmp_path / "out" / "data.yaml").read_text())
    assert data["names"] == {0: "Car"}


def test_round_trip_and_empty_frames(tmp_path: Path) -> None:
    labels = [row for row in random_labels(12) if row["state"] == "positive"]
    export(drive(tmp_path, labels), "s1", tmp_path / "out")
    images = images_of(tmp_path / "out", "train")
    assert [path.stem for path in images] == ["000000", "000001", "000002"]
    assert all(path.is_symlink() and path.exists() for path in images)
    assert labels_of(images[2]).read_text() == ""
    for frame, image in enumerate(images):
        found = sorted(corners(line) for line in labels_of(image).read_text().splitlines())
        own = [row for row in labels if row["frame"] == frame]
        expected = sorted([row[name] for name in BOX_2D] for row in own)
        assert len(found) == len(expected)
        for got, wanted in zip(found, expected, strict=True):
            assert got == pytest.approx(wanted, abs=1e-4)


def test_ignore_regions_stand_aside_or_are_dropped(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "a", 0.9, **box(0, 10)),
        label_row("0000", 0, "b", 0.8, state="ignore", **(box(2, 10) | PIXELS)),
    ]
    store = drive(tmp_path, labels)
    out = tmp_path / "out"
    kept = export(store, "s1", out)
    assert len((out / "labels" / "0000" / "000000.txt").read_text().splitlines()) == 1
    (line,) = (out / "ignore" / "0000" / "000000.txt").read_text().splitlines()
    assert corners(line) == pytest.approx(list(PIXELS.values()), abs=1e-4)
    assert "the format has none" in kept.text()
    dropped = export(store, "s1", out, ExportOptions(ignore="drop", overwrite=True))
    assert not (out / "ignore" / "0000" / "000000.txt").exists()
    assert [(c.labels, c.ignored) for c in (kept, dropped)] == [(1, 1), (1, 0)]


def test_splits(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3), sequences=("0000", "0001"))
    out = tmp_path / "out"
    export(store, "s1", out, ExportOptions(validation=("0001",)))
    splits = [{path.parent.name for path in images_of(out, name)} for name in ("train", "val")]
    assert splits == [{"0000"}, {"0001"}]
    with pytest.raises(SettingsError, match=r"names '0002', .* there are 0000, 0001"):
        export(store, "s1", tmp_path / "no", ExportOptions(validation=("0002",)))
    export(store, "s1", tmp_path / "all")
    assert images_of(tmp_path / "all", "train") == images_of(tmp_path / "all", "val")


def test_labels_alone(tmp_path: Path) -> None:
    export(
        drive(tmp_path, random_labels(3)), "s1", tmp_path / "out", ExportOptions(labels_only=True)
    )
    assert not (tmp_path / "out" / "images").exists()
    assert len(list((tmp_path / "out" / "labels").rglob("*.txt"))) == 3


def test_bad_input(tmp_path: Path) -> None:
    dark = drive(tmp_path, random_labels(3), images=False)
    with pytest.raises(MissingEvidenceError, match="yolo labels images"):
        export(dark, "s1", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    store = drive(tmp_path, random_labels(3))
    export(store, "s1", tmp_path / "out")
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path / "out")
