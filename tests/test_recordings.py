"""`tcrdata view`: a store's sequence as a recording, read back."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest
from cli_runs import build_command, done, refused
from kitti_tree import DRIVE, write_raw

pytest.importorskip("rerun")

from rerun.chunk import RrdReader

FRAMES = 8


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    write_raw(folder / "kitti", frames=FRAMES)
    done(*build_command(folder / "kitti", folder / "store"))
    return folder / "store"


def rows_by_entity(path: Path) -> Counter[str]:
    found: Counter[str] = Counter()
    for chunk in RrdReader(path).stream():
        if not chunk.is_static:
            found[chunk.entity_path] += chunk.num_rows
    return found


def boxes_by_frame(path: Path, kind: str) -> dict[int, int]:
    found = {}
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == f"/world/level/boxes/{kind}":
            for row in chunk.to_record_batch().to_pylist():
                found[row["frame"]] = len(row["Boxes3D:centers"])
    return found


def test_a_recording_holds_what_the_store_holds(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "s.rrd"
    result = done("view", "--store", store, "--sequence", DRIVE, "--out", out)
    assert result.out == f"{out}\n"
    assert f"next: rerun {out}" in result.err
    rows = rows_by_entity(out)
    for entity in ("", "/points", "/boxes/labels", "/boxes/rejected", "/camera/image"):
        assert rows[f"/world/level{entity}"] == FRAMES
    query = "select frame, count(*) as n from labels group by all"
    labels = done("sql", query, "--store", store, "--json").json
    shown = boxes_by_frame(out, "labels")
    assert {row["frame"]: row["n"] for row in labels} == {f: n for f, n in shown.items() if n}
    assert sum(boxes_by_frame(out, "truth").values()) > 0
    assert [path.name for path in out.parent.iterdir()] == ["s.rrd"]


def test_frames_and_truth_can_be_left_out(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "s.rrd"
    command = ("view", "--store", store, "--out", out, "--frames", "2-4", "--no-truth", "--json")
    report = done(*command).json
    assert report["frames"] == 3
    assert report["bytes"] == out.stat().st_size
    assert boxes_by_frame(out, "truth") == {2: 0, 3: 0, 4: 0}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--sequence", "nope"), f"no sequence 'nope'; there are: {DRIVE}"),
        (("--frames", "90-99"), "no usable frame among --frames 90-99"),
        (("--selection", "nope"), "no selection 'nope'; there are: tcrdata"),
    ],
)
def test_what_is_not_there_is_named(
    store: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    out = tmp_path / "s.rrd"
    assert message in refused("view", "--store", store, "--out", out, *arguments)
    assert not list(tmp_path.iterdir())


def test_a_folder_is_no_file_to_write(store: Path, tmp_path: Path) -> None:
    assert "is a folder" in refused("view", "--store", store, "--out", tmp_path)


def test_without_the_extra_one_line_says_what_to_install(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "tcrdata.views.rerun_recording", raising=False)
    monkeypatch.setitem(sys.modules, "rerun", None)
    line = refused("view", "--store", store, "--out", tmp_path / "s.rrd")
    assert "pip install 'tcrdata[viz]'" in line
