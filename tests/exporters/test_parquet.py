"""The dataset read back with Hugging Face's `datasets`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from image_worlds import BOX, BOX_2D, PIXELS, drive, random_labels
from label_worlds import IDENTITY, PROJECTION, box, label_row

from tcrdata.errors import TcrdataError
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.parquet import export


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE", "HF_DATASETS_DISABLE_PROGRESS_BARS"):
        monkeypatch.setenv(name, "1")


def load(out: Path, cache: Path) -> Any:
    import datasets

    return datasets.load_dataset(str(out), split="train", cache_dir=str(cache))


def rows(out: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = pq.read_table(out / "data").to_pylist()
    return found


def test_one_box_by_hand_in_datasets(tmp_path: Path) -> None:
    place = box(10.0, 20.0, yaw=-1.5) | PIXELS | {"number_of_points": 7, "speed_mps": 2.5}
    store = drive(tmp_path, [label_row("0000", 1, "p", 0.875, track_id="t", **place)])
    card = export(store, "s1", tmp_path / "out")
    empty, one, _ = load(tmp_path / "out", tmp_path / "cache")
    assert one["image"].size == (12, 4)
    assert one["image"].convert("RGB").getpixel((0, 0)) == (40, 40, 40)
    assert (one["sequence"], one["frame"], one["timestamp_ns"]) == ("0000", 1, 10**8)
    assert (one["projection"], one["camera_T_level"]) == (PROJECTION, IDENTITY)
    assert one["objects"] == [
        {"state": "positive", "category": "Car", "score": 0.875, "track_id": "t",
         "proposal_id": "p", "box_3d": [10.0, 1.0, 20.0, 4.0, 2.0, 1.5, -1.5],
         "box_2d": [100.0, 50.5, 200.0, 150.0], "number_of_points": 7, "speed_mps": 2.5}
    ]  # fmt: skip
    assert empty["objects"] == []
    assert (card.labels, card.files) == (1, 2)
    assert "(cos yaw, 0, -sin yaw)" in (tmp_path / "out" / "README.md").read_text()


def test_features_are_those_of_the_columns(tmp_path: Path) -> None:
    import datasets

    export(drive(tmp_path, random_labels(3)), "s1", tmp_path / "out")
    (path,) = (tmp_path / "out" / "data").iterdir()
    kind = pq.read_schema(path)
    features = datasets.Features.from_arrow_schema(kind)
    assert isinstance(features["image"], datasets.Image)
    assert features.arrow_schema.remove_metadata() == kind.remove_metadata()


def test_round_trip(tmp_path: Path) -> None:
    labels = random_labels(12)
    export(drive(tmp_path, labels), "s1", tmp_path / "out")
    frames = rows(tmp_path / "out")
    assert [frame["frame"] for frame in frames] == [0, 1, 2]
    assert frames[0]["image"]["bytes"] == (tmp_path / "0000" / "0.png").read_bytes()
    expected = {label["proposal_id"]: label for label in labels}
    found = [item for frame in frames for item in frame["objects"]]
    assert len(found) == len(expected)
    for item in found:
        row = expected[item["proposal_id"]]
        assert item["state"] == row["state"]
        assert item["box_3d"] == pytest.approx([row[name] for name in BOX], abs=1e-4)
        assert item["box_2d"] == pytest.approx([row[name] for name in BOX_2D], abs=1e-4)


def test_files_are_bounded_and_tell_their_number(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(12), sequences=("0000", "0001"))
    export(store, "s1", tmp_path / "out", shard_bytes=1)
    names = ["train-00000-of-00002.parquet", "train-00001-of-00002.parquet"]
    assert sorted(path.name for path in (tmp_path / "out" / "data").iterdir()) == names
    assert len(load(tmp_path / "out", tmp_path / "cache")) == 6
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path / "out")
    export(store, "s1", tmp_path / "out", ExportOptions(overwrite=True))
    names = ["train-00000-of-00001.parquet"]
    assert [path.name for path in (tmp_path / "out" / "data").iterdir()] == names


def test_ignore_regions_are_marked_or_dropped(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(12))
    for option, expected in (("keep", 3), ("drop", 0)):
        out = tmp_path / option
        card = export(store, "s1", out, ExportOptions(ignore=option))  # type: ignore[arg-type]
        states = [item["state"] for frame in rows(out) for item in frame["objects"]]
        assert states.count("ignore") == card.ignored == expected
        assert states.count("positive") == card.labels == 9


def test_a_drive_without_images_has_rows_without(tmp_path: Path) -> None:
    export(drive(tmp_path, random_labels(3), images=False), "s1", tmp_path / "out")
    frames = load(tmp_path / "out", tmp_path / "cache")
    assert [frame["image"] for frame in frames] == [None] * 3
    assert sum(len(frame["objects"]) for frame in frames) == 3
