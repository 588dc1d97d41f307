"""Killed writers, racing writers, full disks, torn files."""

from __future__ import annotations

import errno
import multiprocessing
import os
import random
import signal
import time
from pathlib import Path

import pytest
from store_rows import UNIT, commit, confidences, contents, evidence

from tcrdata.errors import ConflictError, StoreError
from tcrdata.store import Unit, filesystem, open_store

UNITS = [Unit("ground", "kitti", f"{number:04d}", 1) for number in range(4)]
KILLS = 20


@pytest.fixture(scope="module")
def processes():
    """Processes that start in milliseconds, from a server that has imported the store."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tcrdata.store.store", "store_rows"])
    return context


def build(url, ready=None):
    """What a build does: every unit that is not done; resumable."""
    store = open_store(url, create=True)
    if ready is not None:
        ready.set()
    for number, unit in enumerate(UNITS):
        if not store.is_done(unit, "s", {"n": str(number)}):
            rows = {"confidences": confidences(50 + number), "point_evidence": evidence(range(30))}
            commit(store, unit, inputs={"n": str(number)}, **rows)
    store.checkpoint(least=1)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Every file of a build that nothing interrupted."""
    url = str(tmp_path_factory.mktemp("undisturbed") / "store")
    build(url)
    return contents(open_store(url))


def test_a_build_killed_at_any_moment_resumes_to_the_same_files(tmp_path, processes, undisturbed):
    start = time.perf_counter()
    build(str(tmp_path / "timed"))
    seconds = time.perf_counter() - start
    moments = random.Random(7)
    interrupted = 0
    for kill in range(KILLS):
        url = str(tmp_path / f"killed{kill}")
        ready = processes.Event()
        process = processes.Process(target=build, args=(url, ready))
        process.start()
        assert ready.wait(20)
        time.sleep(moments.uniform(0, seconds))
        process.kill()
        process.join()
        interrupted += process.exitcode == -signal.SIGKILL
        for record in open_store(url).records():
            assert all((Path(url) / f.path).stat().st_size == f.bytes for f in record.files)
        build(url)
        assert contents(open_store(url)) == undisturbed
        assert not (Path(url) / "tmp").exists()
    assert interrupted > KILLS // 2


@pytest.mark.parametrize("stop_at", range(1, 29, 3))
def test_a_build_killed_between_any_two_system_calls_resumes(
    stop_at, tmp_path, processes, undisturbed
):
    url = str(tmp_path / "killed")
    process = processes.Process(target=_build_until, args=(url, stop_at))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    build(url)
    assert contents(open_store(url)) == undisturbed


def _build_until(url, stop_at):
    calls = iter(range(1, 10**6))

    def dying(call):
        def counted(*args, **kwargs):
            if next(calls) == stop_at:
                os.kill(os.getpid(), signal.SIGKILL)
            return call(*args, **kwargs)

        return counted

    os.fsync, os.link = dying(os.fsync), dying(os.link)
    build(url)


def _race(url, worker, barrier, results, same):
    store = open_store(url)
    outcome = "committed"
    barrier.wait(20)
    for number in range(5):
        unit = Unit("ground", "kitti", f"{number:04d}", 1)
        value = 0.5 if same else worker / 10
        try:
            commit(store, unit, confidences=confidences(20, value))
        except ConflictError:
            outcome = "conflict"
        results.put((number, worker, outcome))


@pytest.mark.parametrize("same", [True, False])
def test_of_eight_racing_writers_one_wins_and_nobody_tears(disk, processes, same):
    barrier, results = processes.Barrier(8), processes.Queue()
    workers = [
        processes.Process(target=_race, args=(disk.url, n, barrier, results, same))
        for n in range(8)
    ]
    for worker in workers:
        worker.start()
    outcomes = [results.get(timeout=30)[2] for _ in range(40)]
    for worker in workers:
        worker.join()
    records = disk.records()
    assert [record.generation for record in records] == [1] * 5
    assert disk.read("confidences").num_rows == 100
    for record in records:
        rows = disk.read("confidences", sequence=record.unit.sequence)
        assert len(set(rows["confidence"].to_pylist())) == 1
    if same:
        assert set(outcomes) == {"committed"}
        assert len(contents(disk)) == 1 + 5 + 5
    assert not (Path(disk.url) / "tmp").exists()


def _create(url, worker, barrier, results):
    files = filesystem.Filesystem(url)
    barrier.wait(20)
    for number in range(20):
        results.put((number, worker, files.create(f"x/{number}", f"{worker}".encode() * 5000)))


def test_exclusive_creation_has_one_winner_each_time(tmp_path, processes):
    barrier, results = processes.Barrier(8), processes.Queue()
    args = (str(tmp_path), barrier, results)
    workers = [processes.Process(target=_create, args=(args[0], n, *args[1:])) for n in range(8)]
    for worker in workers:
        worker.start()
    outcomes = [results.get(timeout=30) for _ in range(160)]
    for worker in workers:
        worker.join()
    winners = {number: worker for number, worker, won in outcomes if won}
    assert sum(won for *_, won in outcomes) == len(winners) == 20
    for number, worker in winners.items():
        assert (tmp_path / f"x/{number}").read_bytes() == f"{worker}".encode() * 5000


def test_a_living_writers_files_are_left_alone(disk):
    with disk.writer(UNIT, settings_hash="s", inputs={}) as writer:
        writer.append("point_evidence", evidence(range(3)))
        other = open_store(disk.url, create=True)
        commit(other, UNITS[3], confidences=confidences(1))
        commit(other, UNIT, point_evidence=evidence(range(3)))
    assert disk.record(UNIT).generation == 1
    assert disk.read("point_evidence").num_rows == 3


def test_a_file_too_large_for_its_place_says_what_to_do():
    with (
        pytest.raises(StoreError, match="allows no file so large; put the store elsewhere"),
        filesystem.storage_errors("table flows"),
    ):
        raise OSError(errno.EFBIG, "File too large")


@pytest.mark.parametrize("call", ["fsync", "link", "write"])
@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_full_disk_is_one_line_and_leaves_nothing_half_visible(disk, monkeypatch, call, after):
    commit(disk, UNITS[3], confidences=confidences(1))
    left = iter([True] * after)

    def full(real):
        def fails(*args, **kwargs):
            if next(left, False):
                return real(*args, **kwargs)
            raise OSError(errno.ENOSPC, "No space left on device")

        return fails

    with monkeypatch.context() as patched:
        if call == "write":
            patched.setattr(filesystem.HashingFile, "write", full(filesystem.HashingFile.write))
        else:
            patched.setattr(os, call, full(getattr(os, call)))
        with pytest.raises(
            StoreError, match="the disk is full; free some space and run again"
        ) as error:
            commit(disk, confidences=confidences(5), point_evidence=evidence(range(600)))
    assert "\n" not in str(error.value)
    fresh = open_store(disk.url, create=True)
    assert [record.unit for record in fresh.records()] == [UNITS[3]]
    assert not (Path(disk.url) / "tmp").exists()
    commit(fresh, confidences=confidences(5), point_evidence=evidence(range(600)))
    assert fresh.read("point_evidence").num_rows == 600


@pytest.mark.parametrize("table", ["confidences", "point_evidence"])
@pytest.mark.parametrize("keep", [0, 3, 200])
def test_a_torn_parquet_file_is_named(disk, table, keep):
    commit(disk, confidences=confidences(5), point_evidence=evidence(range(5)))
    path = Path(disk.url) / disk.files(table)[0].path
    path.write_bytes(path.read_bytes()[:keep])
    for read in (
        lambda: disk.read(table, frame=1),
        lambda: disk.connect(tables=[table]),
        lambda: disk.scan(table),
    ):
        with pytest.raises(StoreError, match=f"{path.name} is damaged or missing") as error:
            read()
        assert "\n" not in str(error.value)
    path.unlink()
    with pytest.raises(StoreError, match=f"{path.name} is damaged or missing"):
        open_store(disk.url).read(table)


@pytest.mark.parametrize("torn", ["", "{", '{"unit": {}}', "[]", "\x00\xff"])
@pytest.mark.parametrize("kind", ["commits", "snapshots", "checkpoints", "selections"])
def test_a_torn_json_file_is_named(disk, torn, kind):
    commit(disk, confidences=confidences(5))
    disk.freeze("first")
    disk.checkpoint(least=1)
    disk.point_to("abcdef", "a")
    path = next(path for path in (Path(disk.url) / kind).rglob("*.json"))
    path.write_bytes(torn.encode("latin-1"))
    if kind != "commits":
        commit(disk, UNITS[3], confidences=confidences(1))
    fresh = open_store(disk.url)
    read = {
        "commits": lambda: fresh.record(UNIT),
        "snapshots": lambda: fresh.snapshot("first"),
        "checkpoints": fresh.records,
        "selections": fresh.newest_selection,
    }[kind]
    with pytest.raises(StoreError, match=f"{path.name} is (damaged|not a)"):
        read()


def test_a_torn_store_file_is_named(disk):
    (Path(disk.url) / "store.json").write_text("{")
    with pytest.raises(StoreError, match=r"store\.json is damaged"):
        open_store(disk.url)


def test_a_damaged_file_under_a_contents_name_is_named_not_trusted(disk):
    commit(disk, confidences=confidences(5))
    path = Path(disk.url) / disk.files("confidences")[0].path
    path.write_bytes(b"PAR1")
    with pytest.raises(StoreError, match=f"{path.name} is damaged: delete it and run again"):
        commit(disk, settings="t", confidences=confidences(5))


def test_a_stray_file_among_the_records_is_named(disk):
    commit(disk, confidences=confidences(5))
    (Path(disk.url) / "commits/kitti/0001/notes.txt").touch()
    with pytest.raises(StoreError, match=r"notes\.txt is not a commit record: move it out"):
        disk.records()
