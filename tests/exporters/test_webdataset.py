"""WebDataset shards read back with the `webdataset` package."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import pytest
import webdataset
from image_worlds import BOX, BOX_2D, PIXELS, drive, random_labels
from label_worlds import IDENTITY, PROJECTION, box, label_row

from tcrdata.errors import TcrdataError
from tcrdata.exporters.labels import ExportOptions
from tcrdata.exporters.webdataset import export


def samples(out: Path) -> list[dict[str, Any]]:
    shards = [str(path) for path in sorted(out.glob("*.tar"))]
    return list(webdataset.WebDataset(shards, shardshuffle=False, empty_check=False))


def test_one_box_by_hand(tmp_path: Path) -> None:
    place = box(10.0, 20.0, yaw=-1.5) | PIXELS | {"number_of_points": 7, "speed_mps": 2.5}
    store = drive(tmp_path, [label_row("0000", 1, "p", 0.875, track_id="t", **place)])
    card = export(store, "s1", tmp_path / "out", ExportOptions(category="Van"))
    empty, one, _ = samples(tmp_path / "out")
    assert (empty["__key__"], one["__key__"]) == ("0000/000000", "0000/000001")
    assert one["png"] == (tmp_path / "0000" / "1.png").read_bytes()
    assert json.loads(one["json"]) == {
        "dataset": "kitti", "sequence": "0000", "frame": 1, "timestamp_ns": 10**8,
        "width_px": 1200, "height_px": 360, "projection": PROJECTION,
        "camera_T_level": IDENTITY, "level_T_sensor": IDENTITY,
        "objects": [
            {"state": "positive", "category": "Van", "score": 0.875, "track_id": "t",
             "proposal_id": "p", "box_3d": [10.0, 1.0, 20.0, 4.0, 2.0, 1.5, -1.5],
             "box_2d": [100.0, 50.5, 200.0, 150.0], "number_of_points": 7, "speed_mps": 2.5}
        ],
    }  # fmt: skip
    assert json.loads(empty["json"])["objects"] == []
    assert (card.labels, card.files) == (1, 1)
    assert "(cos yaw, 0, -sin yaw)" in card.text()


def test_round_trip(tmp_path: Path) -> None:
    labels = random_labels(12)
    export(drive(tmp_path, labels), "s1", tmp_path / "out")
    found = [o for s in samples(tmp_path / "out") for o in json.loads(s["json"])["objects"]]
    rows = {label["proposal_id"]: label for label in labels}
    assert len(found) == len(rows)
    for item in found:
        row = rows[item["proposal_id"]]
        assert item["state"] == row["state"]
        assert item["box_3d"] == pytest.approx([row[name] for name in BOX], abs=1e-4)
        assert item["box_2d"] == pytest.approx([row[name] for name in BOX_2D], abs=1e-4)


def test_shards_stay_below_their_size_and_equal_ones_are_equal(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(40), sequences=("0000", "0001"))
    bound = 2 * tarfile.RECORDSIZE
    card = export(store, "s1", tmp_path / "out", shard_bytes=bound)
    shards = sorted((tmp_path / "out").glob("*.tar"))
    assert [path.name for path in shards[:2]] == ["000000.tar", "000001.tar"]
    assert card.files == len(shards) > 2
    # A frame of 20 labels alone is larger than the bound: it has a shard of its own.
    assert all(path.stat().st_size <= bound for path in shards[2:])
    assert [s["__key__"] for s in samples(tmp_path / "out")] == [
        f"{sequence}/{frame:06d}" for sequence in ("0000", "0001") for frame in range(3)
    ]
    export(store, "s1", tmp_path / "again", shard_bytes=bound)
    for path in shards:
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()


def test_an_overwritten_export_leaves_no_older_shard(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(40))
    export(store, "s1", tmp_path / "out", shard_bytes=1)
    assert len(list((tmp_path / "out").iterdir())) == 3
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path / "out")
    export(store, "s1", tmp_path / "out", ExportOptions(overwrite=True))
    assert len(samples(tmp_path / "out")) == 3


def test_ignore_regions_are_marked_or_dropped(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(12))
    for option, expected in (("keep", 3), ("drop", 0)):
        out = tmp_path / option
        card = export(store, "s1", out, ExportOptions(ignore=option))  # type: ignore[arg-type]
        states = [o["state"] for s in samples(out) for o in json.loads(s["json"])["objects"]]
        assert states.count("ignore") == card.ignored == expected
        assert states.count("positive") == card.labels == 9


def test_a_drive_without_images_has_samples_without(tmp_path: Path) -> None:
    store = drive(tmp_path, random_labels(3), images=False)
    card = export(store, "s1", tmp_path / "out")
    assert [set(s) & {"png", "json"} for s in samples(tmp_path / "out")] == [{"json"}] * 3
    assert "in 0 of 3 samples" in card.text()
