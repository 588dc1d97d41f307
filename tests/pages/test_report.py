"""The report of a selection: one file, true to the store, that opens on a desk and on a phone."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from browser import visit
from cli_runs import done, refused
from kitti_tree import write_raw
from PIL import Image
from rule_worlds import GOOD_TRACK, put_tracks

import tcrdata
from tcrdata.pages.report import write_report
from tcrdata.rules import select
from tcrdata.store import open_store

FRAMES = 12
SECTIONS = ["funnel", "scores", "labels", "tracks", "gallery", "rules", "parameters", "left-out"]
MOST_BYTES = 20_000_000
OUTSIDE = re.compile(r"""(?:src|href)="(?!\#|data:)|url\(\s*["']?(?!data:)|@import|//\w+\.\w+/""")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    return folder


@pytest.fixture(scope="module")
def store(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    url = tmp_path_factory.mktemp("built") / "store"
    done("build", "--dataset", "kitti", "--root", root, "--store", url, "--workers", 1)
    return url


@pytest.fixture(scope="module")
def page(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page") / "new" / "report.html"
    told = done("report", "--store", store, "--out", out)
    assert told.out.strip() == str(out)
    assert "next: " in told.err
    return out


def ids(text: str) -> list[str]:
    return re.findall(r'data-copy="([^"]+)"', text)


def test_it_is_one_file_that_asks_for_no_other(page: Path) -> None:
    text = page.read_text()
    assert OUTSIDE.findall(text) == []
    assert len(text.encode()) < MOST_BYTES
    assert sorted(path.name for path in page.parent.iterdir()) == ["report.html"]
    assert re.findall(r'<section id="([\w-]+)"', text) == SECTIONS


def test_it_says_what_the_store_holds(page: Path, store: Path) -> None:
    text = page.read_text()
    handle = tcrdata.open(str(store))
    ((labels, tracks),) = handle.sql(
        "select count(*), count(distinct track_id) from labels where state = 'positive'"
    ).fetchall()
    ((candidates,),) = handle.sql("select count(*) from proposals").fetchall()
    assert f"<b>{labels:,} labels</b> on {tracks:,} track" in text
    assert f"{candidates:,} candidates" in text
    for (rules,) in handle.sql("select rules from selections").fetchall():
        for rule in rules:
            assert f"<b>{rule}</b>" in text
    for name in dict(handle.sql("select parameters from selections").fetchall()[0][0]):
        assert f"<code>{name}</code>" in text


def test_examples_are_candidates_with_pictures(page: Path, store: Path) -> None:
    text = page.read_text()
    shown = ids(text)
    handle = tcrdata.open(str(store))
    known = {name for (name,) in handle.sql("select proposal_id from proposals").fetchall()}
    assert shown
    assert set(shown) <= known
    assert text.count("data:image/webp;base64,") > 0
    accepted = text[text.index("Accepted: a fair sample") : text.index("Accepted, but only just")]
    labelled = handle.sql("select proposal_id from labels where state = 'positive'").fetchall()
    assert set(ids(accepted)) <= {name for (name,) in labelled}
    rejected = text[text.index("<h3>Rejected") : text.index('id="rules"')]
    anyhow = {name for (name,) in handle.sql("select proposal_id from labels").fetchall()}
    assert not set(ids(rejected)) & anyhow
    assert "bound" in rejected


def test_the_same_store_gives_the_same_page(page: Path, store: Path, tmp_path: Path) -> None:
    again = done("report", "--store", store, "--out", tmp_path / "again.html", "--json").json
    assert (tmp_path / "again.html").read_bytes() == page.read_bytes()
    assert again["bytes"] == page.stat().st_size
    assert again["examples"] == len(ids(page.read_text()))
    assert again["scored"] is True


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_shows_it_without_a_complaint(page: Path, tmp_path: Path, width: int) -> None:
    seen = visit(page, tmp_path, width)
    assert seen.inner == width
    assert seen.wide <= width
    assert seen.errors == seen.asked == seen.console == []
    assert seen.smallest >= 11
    pixels = np.asarray(Image.open(seen.screenshot).convert("L"))[:, :width]
    assert pixels.std() > 10


def test_names_cannot_break_the_page(store: Path, tmp_path: Path) -> None:
    copied = tmp_path / "store"
    shutil.copytree(store, copied)
    done("check", "--store", copied, "--name", '<img src="x">', "--set", "min_travel_m=2.5")
    text = report(copied, tmp_path)
    assert '<img src="x">' not in text
    assert "&lt;img src=&quot;x&quot;&gt;" in text
    assert '<span class="changed">2.5</span>' in text


def report(store: Path, folder: Path, *more: object) -> str:
    out = folder / "report.html"
    done("report", "--store", store, "--out", out, *more)
    return out.read_text()


def test_a_dataset_that_moved_leaves_words_in_place_of_pictures(
    root: Path, store: Path, tmp_path: Path
) -> None:
    moved = root.rename(root.with_name("elsewhere"))
    try:
        text = report(store, tmp_path)
    finally:
        moved.rename(root)
    assert "data:image" not in text
    assert "No image: " in text
    assert len(ids(text)) > 5


def test_a_store_without_frames_or_truth_is_reported(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"), create=True)
    tracks = [{**GOOD_TRACK, "frame": n, "track_id": "d/one/track/0000"} for n in range(6)]
    put_tracks(store, "one", [*tracks, {**GOOD_TRACK, "frame": 1, "number_of_points": 7}])
    chosen = select(store, "tcrdata")
    written = write_report(store, chosen.selection_id, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert (written.pictures, written.scored) == (0, False)
    assert "Not scored: " in text
    assert "There is no ground truth" in text
    assert "enough_points" in text[text.index("Nearly accepted") :]


def test_a_selection_of_nothing_is_reported(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"), create=True)
    put_tracks(store, "one", [{**GOOD_TRACK, "number_of_points": 1}])
    chosen = select(store, "tcrdata", {"min_points": 10_000})
    write_report(store, chosen.selection_id, tmp_path / "report.html")
    assert "<b>0 labels</b>" in (tmp_path / "report.html").read_text()


def test_some_drives_alone(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"), create=True)
    for name in ("one", "two"):
        put_tracks(store, name, [{**GOOD_TRACK, "frame": n} for n in range(4)])
    chosen = select(store, "tcrdata")
    write_report(store, chosen.selection_id, tmp_path / "both.html")
    write_report(store, chosen.selection_id, tmp_path / "one.html", ["one"])
    both, one = ((tmp_path / f"{name}.html").read_text() for name in ("both", "one"))
    assert any("/two/" in name for name in ids(both))
    assert {name.split("/")[1] for name in ids(one)} == {"one"}


def test_bad_input_is_refused(store: Path, tmp_path: Path) -> None:
    command = ("report", "--store", store, "--out")
    assert "folder" in refused(*command, tmp_path)
    assert "no sequence 'x'" in refused(*command, tmp_path / "r.html", "--sequence", "x")
    assert "no selection 'x'" in refused(*command, tmp_path / "r.html", "--selection", "x")
    (tmp_path / "file").write_text("")
    assert "--out" in refused(*command, tmp_path / "file" / "r.html")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
