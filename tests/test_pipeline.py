"""Builds: byte-equal, resumable, incremental, blind to labels, and sound when frames are not."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from kitti_tree import DRIVE, image_file, sweep_file, write_raw
from store_files import digests

from tcrdata.dry_runs import dry_run
from tcrdata.errors import DatasetError, SettingsError
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.outcomes import BuildReport
from tcrdata.pipeline import build, plan_build
from tcrdata.status import store_status
from tcrdata.store import Unit, open_store

OTHER = "2011_09_26_drive_0009_sync"
FRAMES = 8


def run(root: Path, store: Path | str, workers: int = 1, **plan: object) -> BuildReport:
    planned = plan_build("kitti", str(root), **plan)  # type: ignore[arg-type]
    return build(planned, str(store), workers=workers, progress=lambda _: None)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    write_raw(folder, drive=OTHER, frames=FRAMES, first_frame=3)
    return folder


@pytest.fixture(scope="module")
def reference(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("reference") / "store"
    report = run(root, store)
    assert report.count("failed") == report.count("skipped") == 0
    return store


def test_the_same_build_twice_is_byte_equal(root: Path, reference: Path, tmp_path: Path) -> None:
    run(root, tmp_path / "again")
    assert digests(tmp_path / "again") == digests(reference)


@pytest.mark.parametrize("sequences", [None, (DRIVE,)])
def test_workers_do_not_change_a_byte(
    root: Path, reference: Path, tmp_path: Path, sequences: tuple[str, ...] | None
) -> None:
    run(root, tmp_path / "parallel", workers=2, sequences=sequences)
    there = digests(tmp_path / "parallel", "data")
    evidence = {path: there[path] for path in there if f"/{DRIVE}/" in path}
    assert evidence
    assert evidence.items() <= digests(reference, "data").items()
    if sequences is None:
        assert digests(tmp_path / "parallel") == digests(reference)


def test_a_second_build_does_nothing(root: Path, reference: Path) -> None:
    before = digests(reference)
    report = run(root, reference)
    assert report.count("made") == 0
    assert report.count("done") == len(report.outcomes) > 10
    assert digests(reference) == before


def test_a_build_sequence_by_sequence_gives_the_same_evidence(
    root: Path, reference: Path, tmp_path: Path
) -> None:
    for sequence in (OTHER, DRIVE):
        run(root, tmp_path / "parts", sequences=(sequence,))
    assert digests(tmp_path / "parts", "data").items() >= digests(reference, "data").items() - {
        item for item in digests(reference, "data").items() if "/_/" in item[0]
    }


def test_two_builds_at_once_are_both_whole(root: Path, reference: Path, tmp_path: Path) -> None:
    store = tmp_path / "both"
    processes = [start_build(root, store, "--sequences", name) for name in (DRIVE, OTHER)]
    assert [process.wait(timeout=120) for process in processes] == [0, 0]
    run(root, store)
    evidence = {k: v for k, v in digests(reference, "data").items() if "/_/" not in k}
    assert evidence.items() <= digests(store, "data").items()


def start_build(root: Path, store: Path, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tcrdata", "build", "--dataset", "kitti"]
    command += ["--root", str(root), "--store", str(store), "--workers", "2", *more]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def test_killed_and_resumed_ends_byte_equal(root: Path, reference: Path, tmp_path: Path) -> None:
    store = tmp_path / "killed"
    moments = random.Random(0)
    kills = 0
    for _ in range(6):
        process = start_build(root, store)
        time.sleep(moments.uniform(0.8, 3.0))
        kills += process.poll() is None
        process.kill()
        process.wait()
    assert kills
    run(root, store)
    assert digests(store) == digests(reference)


def test_a_stopped_build_keeps_what_is_done(root: Path, tmp_path: Path) -> None:
    process = start_build(root, tmp_path / "stopped")
    while not (tmp_path / "stopped" / "commits" / "kitti").is_dir() and process.poll() is None:
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    process.wait(timeout=60)
    report = run(root, tmp_path / "stopped")
    assert report.count("done") >= 1


def test_labels_are_never_read_to_make_labels(root: Path, reference: Path, tmp_path: Path) -> None:
    blind = tmp_path / "kitti"
    shutil.copytree(root, blind)
    for labels in blind.rglob("tracklet_labels.xml"):
        labels.unlink()
    run(blind, tmp_path / "store")

    def rows_but_truth(store: Path) -> dict[str, str]:
        files = digests(store, "data")
        return {
            path.rpartition("/")[0] + sha: sha
            for path, sha in files.items()
            if path.split("/")[1] in ("proposals", "confidences", "egomotions", "point_evidence")
        }

    assert rows_but_truth(tmp_path / "store") == rows_but_truth(reference)
    seen, blinded = (open_store(str(s)).read("labels") for s in (reference, tmp_path / "store"))
    assert blinded.drop(["selection_id"]).equals(seen.drop(["selection_id"]))
    assert open_store(str(tmp_path / "store")).read("ground_truth").num_rows == 0


def test_frames_that_cannot_be_read_become_rows_and_the_rest_is_built(
    root: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "kitti"
    shutil.copytree(root, damaged)
    folder = next(damaged.rglob(DRIVE))
    nan = sweep_file(folder, 2)
    data = bytearray(nan.read_bytes())
    data[0:4] = b"\x00\x00\xc0\x7f"
    nan.write_bytes(bytes(data))
    cut = sweep_file(folder, 4)
    cut.write_bytes(cut.read_bytes()[:-7])
    sweep_file(folder, 5).write_bytes(b"")
    picture = image_file(folder, 1)
    picture.write_bytes(picture.read_bytes()[:-30])
    report = run(damaged, tmp_path / "store", sequences=(DRIVE,), presets=("all",))
    assert report.count("failed") == 0
    rows = open_store(str(tmp_path / "store")).read("frames").to_pylist()
    errors = {row["frame"]: row["error"] for row in rows if row["status"] == "error"}
    assert sorted(errors) == [2, 4, 5]
    assert "no finite x" in errors[2]
    assert [row["frame"] for row in rows if not row["has_image"] and row["status"] == "ok"] == [1]
    frames = next(o for o in report.outcomes if o.unit.stage == "frames")
    assert [frame for frame, _ in frames.frame_errors] == [1, 2, 4, 5]


def test_a_drive_without_images_builds_and_image_cues_abstain(tmp_path: Path) -> None:
    write_raw(tmp_path / "kitti", frames=FRAMES, images=False)
    report = run(tmp_path / "kitti", tmp_path / "store", presets=("all",))
    assert report.count("failed") == report.count("skipped") == 0
    store = open_store(str(tmp_path / "store"))
    assert store.read("flows").num_rows == 0
    assert store.read("egomotions", method="odometry").num_rows == FRAMES - 1
    assert [outcome.frame_errors for outcome in report.outcomes if outcome.frame_errors] == []


def test_a_broken_drive_fails_alone_and_is_tried_again(root: Path, tmp_path: Path) -> None:
    broken = tmp_path / "kitti"
    shutil.copytree(root, broken)
    labels = next(broken.rglob(OTHER)) / "tracklet_labels.xml"
    labels.write_text("<broken")
    report = run(broken, tmp_path / "store")
    assert [(o.unit.sequence, o.unit.stage) for o in report.outcomes if o.state == "failed"] == [
        (OTHER, "ground_truth")
    ]
    shutil.copyfile(next(root.rglob(OTHER)) / "tracklet_labels.xml", labels)
    again = run(broken, tmp_path / "store")
    assert (again.count("made"), again.count("failed")) == (1, 0)


def test_missing_calibration_fails_the_drive_with_its_name(root: Path, tmp_path: Path) -> None:
    broken = tmp_path / "kitti"
    shutil.copytree(root, broken)
    next(broken.rglob("calib_velo_to_cam.txt")).unlink()
    report = run(broken, tmp_path / "store")
    failed = [outcome for outcome in report.outcomes if outcome.state == "failed"]
    assert {outcome.unit.stage for outcome in failed} >= {"frames"}
    assert all("calib_velo_to_cam.txt" in str(outcome.error) for outcome in failed)
    assert report.count("skipped") > 0
    assert report.selections == ()


def test_a_failed_rebuild_hides_nothing_and_is_forgotten_when_mended(
    root: Path, tmp_path: Path
) -> None:
    movable = tmp_path / "kitti"
    shutil.copytree(root, movable)
    store = tmp_path / "store"
    run(movable, store, sequences=(DRIVE,))
    before = digests(store, "data")
    calibration = next(movable.rglob("calib_velo_to_cam.txt"))
    text = calibration.read_text()
    calibration.unlink()
    failed = run(movable, store, sequences=(DRIVE,)).count("failed")
    status = store_status(open_store(str(store)))
    assert status.failed == failed >= 1
    assert any("calib_velo_to_cam.txt" in message for _, _, message in status.problems)
    assert digests(store, "data") == before
    assert open_store(str(store)).read("frames").num_rows == FRAMES
    calibration.write_text(text)
    assert run(movable, store, sequences=(DRIVE,)).count("made") == 0
    mended = store_status(open_store(str(store)))
    assert (mended.failed, mended.missing, mended.problems) == (0, 0, [])


def test_frames_that_are_not_there_hide_nothing(root: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    run(root, store, sequences=(DRIVE,))
    report = run(root, store, sequences=(DRIVE,), frames=parse_frame_ranges("500-600"))
    assert report.count("failed") == 1
    assert open_store(str(store)).read("frames").num_rows == FRAMES


def test_other_frames_make_a_new_generation(root: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    run(root, store, sequences=(DRIVE,), frames=parse_frame_ranges("0-5"))
    unit = Unit("frames", "kitti", DRIVE, 1)
    first = open_store(str(store)).record(unit)
    assert first is not None
    assert first.tables["frames"] == 6
    report = run(root, store, sequences=(DRIVE,))
    assert report.count("made") > 1
    second = open_store(str(store)).record(unit)
    assert second is not None
    assert (second.generation, second.tables["frames"]) == (first.generation + 1, FRAMES)


def test_a_changed_setting_remakes_its_cue_and_what_needs_it(root: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    run(root, store, sequences=(DRIVE,))
    report = run(root, store, sequences=(DRIVE,), assignments={"free_space.margin_m": "0.25"})
    made = {outcome.unit.stage for outcome in report.outcomes if outcome.state == "made"}
    done = {outcome.unit.stage for outcome in report.outcomes if outcome.state == "done"}
    assert {"free_space", "regions_free_space", "tracks"} <= made
    assert {"frames", "ground", "odometry"} <= done


def test_a_dry_run_says_what_is_to_do_and_writes_nothing(
    root: Path, reference: Path, tmp_path: Path
) -> None:
    plan = plan_build("kitti", str(root))
    report = dry_run(plan, str(tmp_path / "absent"))
    assert report.count("todo") == len(report.outcomes)
    assert not (tmp_path / "absent").exists()
    before = digests(reference)
    assert dry_run(plan, str(reference)).count("done") == len(report.outcomes)
    assert digests(reference) == before


def test_a_build_fits_in_memory_alone(root: Path) -> None:
    report = run(root, "memory://pipeline", sequences=(DRIVE,), workers=2)
    assert report.count("made") == len(report.outcomes)


def test_a_plan_names_what_is_unknown(root: Path) -> None:
    with pytest.raises(DatasetError, match="no sequence nowhere; there are 2011_09_26_drive"):
        plan_build("kitti", str(root), sequences=("nowhere",))
    with pytest.raises(SettingsError, match="max_cycle_error_m"):
        plan_build("kitti", str(root), assignments={"max_cycle_eror_m": "1"})
    with pytest.raises(SettingsError, match="did you mean margin_m"):
        plan_build("kitti", str(root), assignments={"free_space.margn_m": "1"})
    with pytest.raises(SettingsError, match="unknown cue 'fre_space'"):
        plan_build("kitti", str(root), assignments={"fre_space.margin_m": "1"})
    with pytest.raises(SettingsError, match="preset"):
        plan_build("kitti", str(root), presets=("tcr",))
