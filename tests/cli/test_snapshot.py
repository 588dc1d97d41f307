"""`tcrdata snapshot`, and the commands that read one."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runs import done, refused
from rule_worlds import GOOD_TRACK, put_tracks

from tcrdata.rules import select
from tcrdata.store import Store, open_store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    store = open_store(str(tmp_path / "store"), create=True)
    put_tracks(store, "a", [GOOD_TRACK])
    select(store, "tcrdata", name="early")
    return store


def test_a_snapshot_is_made_listed_and_never_changed(store: Store) -> None:
    made = done("snapshot", "first", "--store", store.url, "--json").json
    assert (made["name"], made["tables"]["proposals"]["rows"]) == ("first", 1)
    assert done("snapshot", "first", "--store", store.url).err.startswith("next: tcrdata check")
    select(store, "tcrdata", {"min_points": 30}, name="late", snapshot="first")
    listed = {row["name"]: row for row in done("snapshot", "--store", store.url, "--json").json}
    assert listed["first"]["selections"] == ["late"]
    assert (listed["first"]["rows"], listed["first"]["files"]) == (5, 5)
    assert len(listed) == 2
    assert "first" in done("snapshot", "--store", store.url).out
    message = refused("snapshot", "first", "--store", store.url)
    assert "already there with other files: a snapshot never changes" in message


def test_check_judges_the_evidence_of_a_snapshot(store: Store) -> None:
    done("snapshot", "first", "--store", store.url)
    put_tracks(store, "b", [GOOD_TRACK, GOOD_TRACK])
    frozen = done("check", "--store", store.url, "--snapshot", "first", "--json").json
    newest = done("check", "--store", store.url, "--json").json
    assert (frozen["proposals_judged"], newest["proposals_judged"]) == (1, 3)
    assert frozen["selection_id"] == store.newest_selection("early")


def test_a_store_at_a_snapshot_knows_nothing_later(store: Store) -> None:
    early = store.newest_selection()
    store.freeze("first")
    put_tracks(store, "b", [GOOD_TRACK, GOOD_TRACK])
    late = select(store, "tcrdata").selection_id
    pinned = store.at("first")
    assert (store.newest_selection(), pinned.newest_selection()) == (late, early)
    assert pinned.newest_selection(late) is None
    assert pinned.read("proposals").num_rows == 1
    assert pinned.read("proposals", dataset="d", sequence="b").num_rows == 0
    assert pinned.connect(tables=["labels"]).sql("from labels").fetchall() != []


def test_export_writes_the_labels_of_a_snapshot(store: Store, tmp_path: Path) -> None:
    store.freeze("first")
    select(store, "tcrdata", {"min_points": 9}, name="late")
    out = ("--store", store.url, "--snapshot", "first", "--out", tmp_path / "out")
    message = refused("export", "kitti-tracking", *out, "--selection", "late")
    assert "no selection 'late'" in message


def test_build_refuses_a_snapshot_that_is_not_there(store: Store, tmp_path: Path) -> None:
    build = ("build", "--dataset", "street", "--root", "frames=3", "--snapshot", "first")
    workers = ("--workers", 1)
    message = refused(*build, *workers, "--store", store.url)
    assert "has no snapshot 'first'" in message
    assert "there is no store" in refused(*build, *workers, "--store", tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("check", "--snapshot", "nope"), "has no snapshot 'nope'"),
        (("export", "kitti", "--out", "x", "--snapshot", "nope"), "has no snapshot 'nope'"),
        (("snapshot", "../up"), "cannot name a folder of the store"),
    ],
)
def test_names_that_are_not_there_are_refused(
    store: Store, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused(*arguments, "--store", store.url)
