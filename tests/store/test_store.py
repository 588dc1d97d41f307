"""Units, generations, reading, snapshots, pointers, versions."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from store_rows import UNIT, commit, confidences, contents, evidence

from tcrdata.errors import ConflictError, QueryError, SchemaError, StoreError
from tcrdata.store import Unit, open_store, parquet


def test_a_unit_is_invisible_until_its_block_ends(store):
    with store.writer(UNIT, settings_hash="s", inputs={"a": "1"}) as writer:
        writer.append("confidences", confidences(3))
        writer.append("point_evidence", evidence([1, 2]))
        assert open_store(store.url).records() == []
        assert store.read("confidences").num_rows == 0
    record = store.record(UNIT)
    assert record.generation == 1
    assert record.tables == {"confidences": 3, "point_evidence": 2}
    assert [(file.table, file.rows) for file in record.files] == [
        ("confidences", 3),
        ("point_evidence", 2),
    ]
    assert store.is_done(UNIT, "s", {"a": "1"})
    assert not store.is_done(UNIT, "t", {"a": "1"})
    assert not store.is_done(UNIT, "s", {"a": "2"})
    assert store.connect().execute("select count(*) from confidences").fetchall() == [(3,)]


def test_a_failed_block_leaves_nothing(disk):
    before = contents(disk)
    with pytest.raises(SchemaError):
        commit(
            disk, confidences=confidences(3), point_evidence=evidence(range(600)), flows={"x": []}
        )
    assert contents(disk) == before
    assert sorted(path.name for path in Path(disk.url).iterdir()) == ["store.json"]


def test_empty_tables_and_failed_frames_are_recorded(store):
    with store.writer(UNIT, settings_hash="s", inputs={}) as writer:
        writer.append("confidences", {})
        writer.append("point_evidence", evidence([]))
        writer.error(9, "sweep 9:\n truncated")
    record = store.record(UNIT)
    assert record.tables == {"confidences": 0, "point_evidence": 0}
    assert record.files == ()
    assert record.failed_frames == ((9, "sweep 9: truncated"),)


def test_the_same_rows_give_the_same_bytes_however_they_are_batched(tmp_path):
    stores = [open_store(str(tmp_path / name), create=True) for name in "ab"]
    for store, batches in zip(stores, ([range(700)], [[n] for n in range(700)]), strict=True):
        with store.writer(UNIT, settings_hash="s", inputs={"b": "2", "a": "1"}) as writer:
            for frames in batches:
                writer.append("point_evidence", evidence(frames))
                ids = [f"p{frame}" for frame in frames]
                writer.append(
                    "confidences",
                    {**confidences(len(ids)), "proposal_id": ids, "frame": list(frames)},
                )
    assert contents(stores[0]) == contents(stores[1])
    assert len(stores[0].files("point_evidence")) == 2


def test_the_same_build_twice_is_byte_equal_and_the_second_commit_changes_nothing(tmp_path):
    stores = [open_store(str(tmp_path / name), create=True) for name in "ab"]
    for store in (*stores, stores[0]):
        commit(store, confidences=confidences(5), point_evidence=evidence(range(3)))
        store.freeze("first")
        store.point_to("id-1", "tcrdata")
    assert contents(stores[0]) == contents(stores[1])


def test_a_redo_takes_the_next_generation_and_readers_take_the_highest(store):
    for settings, value in (("s", 0.1), ("t", 0.2), ("s", 0.1)):
        commit(store, settings=settings, confidences=confidences(1, value))
        assert store.read("confidences", columns=["confidence"]).to_pylist() == [
            {"confidence": value}
        ]
    record = store.record(UNIT)
    assert record.generation == 3
    assert record.settings_hash == "s"
    assert len(store.records()) == 1
    commit(store, settings="s", inputs={"flow": "new"}, confidences=confidences(2))
    assert store.record(UNIT).generation == 4


def test_equal_work_has_equal_digests_whatever_its_generation(store):
    digests = []
    for settings in "sts":
        commit(store, settings=settings, confidences=confidences(1))
        digests.append(store.record(UNIT).digest)
    assert digests[0] == digests[2] != digests[1]


def test_ten_generations_sort_as_numbers(store):
    for number in range(11):
        commit(store, settings=f"s{number}", confidences=confidences(number))
    assert store.record(UNIT).generation == 11
    assert store.read("confidences").num_rows == 10


def test_other_rows_under_the_same_generation_are_a_conflict(store):
    commit(store, confidences=confidences(1))
    with pytest.raises(ConflictError, match=r"g1.json: another writer .* they differ in files"):
        commit(store, confidences=confidences(1, confidence=0.9))
    assert store.read("confidences", columns=["confidence"]).to_pylist() == [{"confidence": 0.5}]


def test_stages_do_not_mistake_each_other(store):
    commit(store, Unit("flow", "kitti", "0001", 1), confidences=confidences(1))
    commit(store, Unit("flow_ransac", "kitti", "0001", 1), settings="r", confidences={})
    commit(store, Unit("flow", "kitti", "0001", 11), settings="e", confidences={})
    assert store.record(Unit("flow", "kitti", "0001", 1)).settings_hash == "s"
    assert store.record(Unit("flow", "kitti", "0001", 2)) is None
    assert [r.unit.stage for r in store.records()] == ["flow", "flow_ransac", "flow"]


def test_reading_narrows_by_unit_and_by_value(store):
    for sequence in ("0001", "0002"):
        unit = Unit("ground", "kitti", sequence, 1)
        commit(store, unit, point_evidence=evidence([5, 6, 7]), confidences=confidences(4))
    assert store.read("point_evidence", sequence="0002", frame=7)["data"].to_pylist() == [
        bytes([7]) * 8
    ]
    assert store.read("point_evidence", frame=7, cue="motion").num_rows == 0
    assert store.read("confidences", frame=2, columns=["sequence"]).to_pydict() == {
        "sequence": ["0001", "0002"]
    }
    assert store.read("confidences", round=2).num_rows == 0
    tables = store.tables("kitti", "0001", 1)
    assert tables.read("point_evidence", columns=["frame"]).to_pydict() == {"frame": [5, 6, 7]}
    assert len(store.files("point_evidence", dataset="kitti", sequence="0001", round=1)) == 1
    with pytest.raises(SchemaError, match="table confidences has no column cue"):
        store.read("confidences", cue="ground")
    with pytest.raises(SchemaError, match="column frame cannot equal 'seven'"):
        store.read("point_evidence", frame="seven")


def test_reading_a_sequence_lists_no_other_one(store, monkeypatch):
    for sequence in ("0001", "0002", "0003"):
        commit(store, Unit("ground", "kitti", sequence, 1), confidences=confidences(4))
    find, listed = store._files.find, []
    monkeypatch.setattr(store._files, "find", lambda path: listed.append(path) or find(path))
    assert store.tables("kitti", "0002", 1).read("confidences").num_rows == 4
    assert listed == ["commits/kitti/0002", "commits/_"]


def test_a_heavy_read_touches_only_the_row_groups_that_match(disk, monkeypatch):
    commit(disk, point_evidence=evidence(range(600), size=2000))
    assert [file.rows for file in disk.files("point_evidence")] == [512, 88]
    touched = []
    read = parquet.pq.ParquetFile.read_row_groups
    monkeypatch.setattr(
        parquet.pq.ParquetFile,
        "read_row_groups",
        lambda self, groups, *rest: touched.extend(groups) or read(self, groups, *rest),
    )
    assert disk.read("point_evidence", frame=520)["frame"].to_pylist() == [520]
    assert touched == [8]
    metadata = parquet.pq.ParquetFile(Path(disk.url) / disk.files("point_evidence")[0].path)
    assert metadata.num_row_groups == 512


def test_arrays_of_arrays_are_one_row_major_list_a_row(store):
    poses = np.arange(32.0).reshape(2, 4, 4)
    rows = {"frame": np.array([0, 1]), "frame_to": [1, 2], "method": ["odometry"] * 2}
    commit(store, egomotions={**rows, "to_T_from": poses})
    assert store.read("egomotions")["to_T_from"].to_pylist() == poses.reshape(2, 16).tolist()


def test_a_snapshot_stays_as_it_was(store):
    commit(store, confidences=confidences(2))
    frozen = store.freeze("first")
    assert store.freeze("first") == frozen
    commit(store, settings="t", confidences=confidences(7))
    commit(store, Unit("ground", "kitti", "0002", 1), confidences=confidences(3))
    assert store.read("confidences").num_rows == 10
    assert store.read("confidences", snapshot="first").num_rows == 2
    count = "select count(*) from confidences"
    assert store.connect(snapshot="first").execute(count).fetchall() == [(2,)]
    assert store.connect().execute(count).fetchall() == [(10,)]
    assert store.snapshot("first") == frozen
    with pytest.raises(ConflictError, match="a snapshot never changes"):
        store.freeze("first")
    with pytest.raises(StoreError, match="no snapshot 'second'; there are: first"):
        store.read("confidences", snapshot="second")


def test_a_snapshot_without_a_name_is_named_by_its_content(store):
    commit(store, confidences=confidences(2), point_evidence=evidence([1]))
    frozen = store.freeze(tables=["confidences", "labels"])
    commit(store, Unit("ground", "kitti", "0002", 1), point_evidence=evidence([1]))
    assert store.freeze(tables=["labels", "confidences"]) == frozen
    assert store.snapshots() == [frozen.name]
    assert store.connect(snapshot=frozen.name).execute("from labels").fetchall() == []
    with pytest.raises(StoreError, match="does not cover table point_evidence"):
        store.files("point_evidence", snapshot=frozen.name)


def test_extra_views_read_the_views_of_their_own_schema(store):
    commit(store, confidences=confidences(2))
    frozen = store.freeze()
    commit(store, settings="t", confidences=confidences(5))
    view = {"checks": "select count(*) as n from confidences"}
    connection = store.connect(views=view)
    store.add_snapshot(connection, frozen.name, "then", view)
    assert connection.execute("from checks").fetchall() == [(5,)]
    assert connection.execute('from "then".checks').fetchall() == [(2,)]
    assert store.connect().execute("from checks").fetchall() == []
    with pytest.raises(QueryError, match=r"the view checks does not bind: .*no_such"):
        store.connect(views={"checks": "select no_such from labels"})


def test_a_connection_sees_the_tables_asked_for(store):
    connection = store.connect(tables=["labels"])
    assert [row[0] for row in connection.execute("show tables").fetchall()] == ["labels"]


def test_the_newest_selection(store):
    assert store.newest_selection() is None
    for selection_id, name in (("abcdef01", "a"), ("abcdef02", "b"), ("0123456789", "a")):
        store.point_to(selection_id, name)
        store.point_to(selection_id, name)
    assert store.newest_selection() == "0123456789"
    assert store.newest_selection("b") == "abcdef02"
    assert store.newest_selection("a") == "0123456789"
    assert store.newest_selection("abcdef01") == "abcdef01"
    assert store.newest_selection("012345") == "0123456789"
    assert store.newest_selection("01234") is None
    with pytest.raises(StoreError, match="'abcdef' is ambiguous: abcdef01, abcdef02"):
        store.newest_selection("abcdef")
    store.point_to("abcdef01", "a")
    assert store.newest_selection() == "abcdef01"


def test_a_checkpoint_answers_for_the_records_it_folds(store, monkeypatch):
    for number in range(5):
        unit = Unit("ground", "kitti", f"{number:04d}", 1)
        commit(store, unit, confidences=confidences(number))
    assert not store.checkpoint(least=6)
    assert store.checkpoint(least=5)
    assert not store.checkpoint(least=1)
    commit(store, Unit("ground", "kitti", "0009", 1), confidences=confidences(9))
    fresh = open_store(store.url)
    read, requests = fresh._files.read, []
    monkeypatch.setattr(fresh._files, "read", lambda path: requests.append(path) or read(path))
    assert fresh.records() == store.records()
    assert requests == ["checkpoints/1.json", "commits/kitti/0009/ground.r1.g1.json"]
    assert fresh.read("confidences").num_rows == 19


def test_a_store_pickles_as_its_url(disk):
    commit(disk, confidences=confidences(2))
    assert pickle.loads(pickle.dumps(disk.tables("kitti", "0001", 1))).read("confidences") == (
        disk.read("confidences")
    )


@pytest.mark.parametrize("name", ["", "a b", "a/b", "..", "a=b", ".hidden", "ü", "a\nb"])
def test_names_that_no_folder_should_have_are_refused(name):
    with pytest.raises(StoreError, match="cannot name a folder of the store: use letters"):
        Unit("flow", "kitti", name, 1)
    with pytest.raises(StoreError, match="the stage"):
        Unit(name, "kitti", "0001", 1)


def test_names_of_real_drives_are_allowed():
    assert str(Unit("flow", "kitti", "2011_09_26_drive_0005_sync", 1)).endswith("round 1")


def test_a_store_may_lie_under_a_name_that_looks_like_a_pattern(tmp_path):
    store = open_store(str(tmp_path / "it's [1]* sequence=3"), create=True)
    commit(store, confidences=confidences(2))
    query = "select distinct sequence from confidences"
    assert store.connect().execute(query).fetchall() == [("0001",)]
    assert store.scan("confidences").collect()["sequence"].to_list() == ["0001", "0001"]


def test_opening_what_is_no_store_says_so(tmp_path):
    with pytest.raises(StoreError, match=r"there is no store at .*none: make one with"):
        open_store(str(tmp_path / "none"))
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(StoreError, match="is not a store and not empty"):
        open_store(str(tmp_path), create=True)
    with pytest.raises(StoreError, match="not a place for a store"):
        open_store("nosuch://bucket")
