"""`train flow`, `build --flow raft` and `evaluate flow` on a few generated frames."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch
from cli_runs import done, refused, run

from tcrdata.cli.train_flow import _change
from tcrdata.errors import ConflictError
from tcrdata.flow_models import copy_model, flow_model
from tcrdata.learning.checkpoints import (
    AVERAGE,
    STATE,
    ModelIdentity,
    Progress,
    read_weights,
    save_checkpoint,
)
from tcrdata.store import Store, open_store

IDENTITY = ("kind", "network", "labels_round", "selection_id", "snapshot", "query", "seed")
QUICK = ("--set", "workers=0", "--set", "batch=1", "--set", "network.iterations=1")
SCRATCH = (
    *QUICK,
    "--set",
    "steps=2",
    "--set",
    "planes.height_px=64",
    "--set",
    "planes.width_px=64",
)
STUDENT = (
    *QUICK, "--set", "steps=3", "--set", "checkpoint_steps=1", "--set", "pairs.height_px=64",
    "--set", "pairs.width_px=64", "--set", "pairs.margin_px=0", "--set",
    "pairs.teacher_iterations=1",
)  # fmt: skip
BUILD = ("build", "--dataset", "demo", "--root", "frames=5", "--preset", "paper", "--workers", "1")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five frames with DIS flow, and RAFT from scratch."""
    url = tmp_path_factory.mktemp("flow") / "store"
    done(*BUILD, "--store", url)
    done("train", "flow", "--store", url, *SCRATCH)
    return url


@pytest.fixture(scope="module")
def taught(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy in which that network was finetuned."""
    url = tmp_path_factory.mktemp("taught") / "store"
    shutil.copytree(built, url)
    done("train", "flow", "--store", url, "--logs", url.with_name("logs"), *STUDENT)
    return url


def flow_rows(store: Store) -> list[dict[str, object]]:
    return [row for row in store.read("models").to_pylist() if row["kind"] == "flow"]


def test_a_network_from_scratch_is_in_use(built: Path) -> None:
    (row,) = flow_rows(open_store(str(built)))
    assert (row["finished"], row["step"], row["parameters"]) == (True, 2, 990162)
    again = done("train", "flow", "--from-scratch", "--store", built, *SCRATCH)
    assert "nothing to do" in again.err


def test_a_network_that_goes_on_with_generated_pairs_stands_in_for_its_start(
    built: Path, tmp_path: Path
) -> None:
    url = tmp_path / "store"
    shutil.copytree(built, url)
    (first,) = flow_rows(open_store(str(built)))
    done("train", "flow", "--generated", "--store", url, *SCRATCH, "--set", "learning_rate=0")
    second = next(
        row for row in flow_rows(open_store(str(url))) if row["model_id"] != first["model_id"]
    )
    assert flow_model(open_store(str(url)))["model_id"] == second["model_id"]
    # Nothing was learnt at that rate: the weights are those it began with, decayed by nothing.
    one, other = (
        read_weights(open_store(str(url)), row["model_id"], AVERAGE) for row in (first, second)
    )
    assert all(torch.equal(value, other[name]) for name, value in one.items())


def test_a_finetuned_network_is_checked_and_its_teacher_stays(taught: Path) -> None:
    store = open_store(str(taught))
    assert len(flow_rows(store)) == 2
    checks = store.read("flow_checks").to_pylist()
    assert [(row["role"], row["frame"]) for row in checks] == [("student", 3), ("teacher", 3)]
    listed = {row["model_id"]: row for row in done("models", "--store", taught, "--json").json}
    student = next(row for row in listed.values() if "teacher" in row["settings"])
    assert student["settings"]["teacher"] in listed
    assert student["samples"] == 2
    states = {row["model_id"]: row["state"] for row in listed.values()}
    used = flow_model(store)["model_id"]
    assert {name for name, state in states.items() if state.endswith(", in use")} == {used}
    assert states[student["model_id"]].split(",")[0] in ("promoted", "rejected")
    (events,) = taught.with_name("logs").iterdir()
    assert ".tfevents." in events.name


def test_the_average_of_a_student_is_of_its_teacher_too(built: Path, tmp_path: Path) -> None:
    url = tmp_path / "store"
    shutil.copytree(built, url)
    done("train", "flow", "--store", url, *STUDENT, "--set", "average=1", "--set", "steps=1")
    teacher, student = (
        read_weights(open_store(str(url)), row["model_id"], AVERAGE)
        for row in sorted(flow_rows(open_store(str(url))), key=lambda row: row["samples"])
    )
    assert all(torch.equal(value, student[name]) for name, value in teacher.items())


def test_a_training_that_was_stopped_gives_the_same_losses(
    built: Path, taught: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = tmp_path / "store"
    shutil.copytree(built, url)
    import tcrdata.learning.flow_runs as runs

    whole = runs.train_flow

    def stopped(*arguments: object, **named: object) -> object:
        def report(progress: object) -> None:
            if progress.step == 2:
                raise KeyboardInterrupt

        return whole(*arguments, **{**named, "report": report})

    monkeypatch.setattr(runs, "train_flow", stopped)
    ended = run("train", "flow", "--store", url, *STUDENT)
    assert (ended.code, ended.err) == (130, "tcrdata: stopped; what is done is kept\n")
    monkeypatch.undo()
    done("train", "flow", "--store", url, "--resume", *STUDENT)
    stores = [open_store(str(path)) for path in (taught, url)]
    one, other = (next(row for row in flow_rows(store) if row["steps"] == 3) for store in stores)
    assert one == other
    first, second = (read_weights(store, one["model_id"], AVERAGE) for store in stores)
    for name, value in first.items():
        assert torch.equal(value, second[name]), name


def test_loaders_and_what_they_keep_change_no_weight(
    built: Path, taught: Path, tmp_path: Path
) -> None:
    url = tmp_path / "store"
    shutil.copytree(built, url)
    other = ("--set", "workers=2", "--set", "pairs.kept_mb=0")
    done("train", "flow", "--store", url, *STUDENT, *other)
    stores = [open_store(str(path)) for path in (taught, url)]
    one, same = (next(row for row in flow_rows(store) if row["steps"] == 3) for store in stores)
    assert one == same
    first, second = (read_weights(store, one["model_id"], AVERAGE) for store in stores)
    assert all(torch.equal(value, second[name]) for name, value in first.items())


def test_a_training_that_was_begun_elsewhere_gives_way_to_the_finished_network(
    built: Path, tmp_path: Path
) -> None:
    (row,) = flow_rows(source := open_store(str(built)))
    own = {name: row[name] for name in IDENTITY}
    identity = ModelIdentity(settings=json.loads(row["settings"]), **own)
    weights = read_weights(source, identity.model_id, AVERAGE)
    zeros = {name: torch.zeros_like(value) for name, value in weights.items()}
    begun = Progress(1, 2, (1.0,), {}, 1, 0, row["parameters"])
    target = open_store(str(tmp_path / "store"), create=True)
    save_checkpoint(target, identity, begun, {AVERAGE: zeros, STATE: {}})
    assert copy_model(source, target) == identity.model_id
    assert flow_rows(target) == [row]
    copied = read_weights(target, identity.model_id, AVERAGE)
    assert all(torch.equal(value, copied[name]) for name, value in weights.items())
    # The one that had begun must not undo what is finished.
    with pytest.raises(ConflictError, match=r"finished model .* meanwhile"):
        save_checkpoint(target, identity, begun, {AVERAGE: zeros, STATE: {}})
    assert flow_rows(target) == [row]


def test_a_build_measures_with_raft(taught: Path) -> None:
    dis = done("evaluate", "flow", "--store", taught, "--json").json
    done(*BUILD, "--store", taught, "--flow", "raft", "--set", "flow.iterations=2")
    rows = open_store(str(taught)).read("flows", columns=["method", "frame", "direction"])
    assert set(rows["method"].to_pylist()) == {"raft"}
    assert rows.num_rows == 8
    raft = done("evaluate", "flow", "--store", taught, "--json").json
    assert {one["method"] for one in dis} == {"dis"}
    assert [one["name"] for one in raft] == [one["name"] for one in dis]
    assert [one["epe_px"] for one in dis] != [one["epe_px"] for one in raft]
    assert [one["zeros"] for one in dis] == [one["zeros"] for one in raft]
    assert "zeros" in done("evaluate", "flow", "--store", taught).out


def test_the_same_frames_and_weights_of_a_file_give_the_same_scores(
    built: Path, tmp_path: Path
) -> None:
    store = open_store(str(built))
    (row,) = flow_rows(store)
    torch.save(read_weights(store, row["model_id"], AVERAGE), tmp_path / "raft.pth")
    frames = ("--dataset", "demo", "--root", "frames=2", "--iterations", 2, "--json")
    own = done("evaluate", "flow", *frames, "--flow", "raft", "--model-store", built).json
    file = done(
        "evaluate", "flow", *frames, "--flow", "raft", "--weights", tmp_path / "raft.pth"
    ).json
    assert own == file
    plan = done(
        *BUILD, "--store", built, "--flow", "raft", "--weights", tmp_path / "raft.pth", "--dry-run"
    )
    assert "flow" in plan.out + plan.err
    assert flow_rows(store) == [row]


def test_what_does_not_fit_together_is_refused(built: Path, tmp_path: Path) -> None:
    assert "no flow network" in refused(*BUILD, "--store", tmp_path / "new", "--flow", "raft")
    assert "for --flow raft" in refused(*BUILD, "--store", built, "--model", "abc")
    assert "no finished flow model 'abc'" in refused(
        *BUILD, "--store", built, "--flow", "raft", "--model", "abc"
    )
    plain = ("build", "--dataset", "demo", "--store", built, "--flow", "dis")
    assert "tcrdata reads no flow" in refused(*plain)
    assert "one of them" in refused("evaluate", "flow", "--store", built, "--root", ".")
    assert "for --flow raft" in refused(
        "evaluate", "flow", "--dataset", "demo", "--root", "frames=2", "--iterations", 4
    )
    assert "build with --flow" in refused("evaluate", "flow", "--store", built, "--iterations", 4)
    assert "no flow pair" in refused("evaluate", "flow", "--root", tmp_path)
    assert "unknown loss 'photo'" in refused("train", "flow", "--store", built, "--losses", "photo")
    assert "is RAFT small" in refused("train", "flow", "--store", built, "--size", "full")
    (row,) = flow_rows(store := open_store(str(built)))
    own = read_weights(store, str(row["model_id"]), AVERAGE)
    torch.save({name: value + 1 for name, value in own.items()}, tmp_path / "other.pth")
    assert "unknown setting" in refused(
        "train", "flow", "--store", built, "--weights", tmp_path / "other.pth", "--set", "nope=1"
    )
    assert flow_rows(open_store(str(built))) == [row]
    for setting in ("steps=0", "batch=0", "learning_rate=nan", "warm_up=2"):
        assert f"train.{setting.split('=')[0]}: " in refused(
            "train", "flow", "--store", built, "--set", setting
        )
    for limit, part in (("most_learnt=0", "learn from"), ("most_held_out=0", "check with")):
        said = refused("train", "flow", "--store", built, *STUDENT, "--set", f"query.{limit}")
        assert f"no pair of frames to {part}" in said
        assert limit.replace("=", " = ") in said
    assert flow_rows(open_store(str(built))) == [row]
    (tmp_path / "void").mkdir()
    shutil.copytree(built, tmp_path / "void", dirs_exist_ok=True)
    shutil.rmtree(tmp_path / "void" / "commits" / "demo")
    said = refused("train", "flow", "--store", tmp_path / "void")
    assert "no pair of frames with images of one size?" in said
    assert "finetunes" in refused(
        "train", "flow", "--store", tmp_path / "empty", "--losses", "teacher"
    )
    for content in (b"none", b"", b"\x80\x02."):
        (tmp_path / "text.pth").write_bytes(content)
        assert "no file of weights" in refused(
            "train", "flow", "--store", built, "--weights", tmp_path / "text.pth"
        )


def test_a_number_that_no_pixel_gave_is_a_dash() -> None:
    row = {"teacher_photometric_error": 0.05, "photometric_error": None}
    assert _change(row, "photometric_error") == "0.0500 -> -"
