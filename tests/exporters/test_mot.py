"""MOTChallenge lines read back, of labels and of tracklets."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest
from label_worlds import box, columns_of, frame_row, label_row, make_store, sequence_row

from tcrdata.errors import MissingEvidenceError
from tcrdata.exporters import kitti_tracking, mot
from tcrdata.exporters.labels import ExportOptions
from tcrdata.store import Store, Unit

_names = itertools.count()


def store_of(tracklets: list[dict[str, Any]]) -> Store:
    store = make_store(
        f"mot{next(_names)}",
        sequences=[sequence_row("0000"), sequence_row("0001")],
        frames=[frame_row(s, f) for s in ("0000", "0001") for f in range(3)],
        labels=[label_row("0000", f, f"p{f}", 0.5, **box(1.0, 10.0), track_id="t")
                for f in range(3)],
    )  # fmt: skip
    if tracklets:
        unit = Unit("tracklets", "kitti", "0000", 1)
        with store.writer(unit, settings_hash="0", inputs={}) as writer:
            writer.append("tracklets", columns_of(tracklets))
    return store


def tracklet_row(frame: int, name: str, *, library: bool, **more: Any) -> dict[str, Any]:
    return {
        "tracklet_id": name, "selection_id": "s1", "frame": frame, "library": library,
        "tracker": "auto", "found": "nearest", **box(2.0, 10.0), "visible_share": 0.75,
        "score": 0.25,
        "number_of_points": 5, "passable": 1.0, "frames_from_sighting": 0, **more,
    }  # fmt: skip


def parse(path: Path) -> list[list[float]]:
    return [[float(field) for field in line.split(",")] for line in path.read_text().splitlines()]


def test_labels_by_hand(tmp_path: Path) -> None:
    card = mot.export(store_of([]), "s1", tmp_path)
    place = box(1.0, 10.0)
    sides = [place[name] for name in ("left_px", "top_px", "right_px", "bottom_px")]
    expected = [sides[0], sides[1], sides[2] - sides[0], sides[3] - sides[1], 0.5, 1.0, 1.0, 10.0]
    for number, line in enumerate(parse(tmp_path / "0000.txt")):
        assert line == pytest.approx([number + 1, 1, *expected])
    assert (tmp_path / "0001.txt").read_text() == ""
    assert (card.files, card.labels) == (2, 3)


def test_tracklets_with_the_library_win_over_those_without(tmp_path: Path) -> None:
    tracklets = [tracklet_row(f, "b", library=True) for f in (0, 1)]
    tracklets += [tracklet_row(2, "c", library=True, score=None, found="library")]
    tracklets += [tracklet_row(f, "a", library=False) for f in range(3)]
    options = ExportOptions(tracklets=True)
    mot.export(store_of(tracklets), "s1", tmp_path / "mot", options)
    lines = parse(tmp_path / "mot" / "0000.txt")
    assert [line[:2] for line in lines] == [[1, 1], [2, 1], [3, 2]]
    assert [line[6] for line in lines] == [0.25, 0.25, 1.0]
    assert lines[0][7] == pytest.approx(2.0)
    kitti_tracking.export(store_of(tracklets), "s1", tmp_path / "kitti", options)
    fields = (tmp_path / "kitti" / "label_02" / "0000.txt").read_text().splitlines()[0].split()
    assert fields[:5] == ["0", "0", "Car", "0", "1"]  # a quarter of it is hidden


def test_nothing_tracked_is_said(tmp_path: Path) -> None:
    with pytest.raises(MissingEvidenceError, match="tcrdata track --selection s1` first"):
        mot.export(store_of([]), "s1", tmp_path, ExportOptions(tracklets=True))
