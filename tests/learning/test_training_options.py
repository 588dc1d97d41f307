"""What a training can be asked for beside its labels: a file of settings, logs, company."""

from __future__ import annotations

import hashlib
import importlib
import json
import multiprocessing
import os
import re
import socket
import struct
import sys
from pathlib import Path
from typing import Any

import pytest
from cli_runs import done, refused
from learnt_worlds import SELECTION, TINY, learnt_world
from store_files import digests

from tcrdata.learning import training
from tcrdata.learning.checkpoints import model_rows
from tcrdata.learning.learner import Learner
from tcrdata.learning.runs import plan_recipe, run_training
from tcrdata.settings import read_toml
from tcrdata.store import Store, open_store

CONFIG = """
steps = 2
batch = 1
workers = 0
checkpoint_steps = 2

[network]
lateral_m = 16
far_m = 32
cell_m = 0.5
widths = [8, 8, 8]
head_width = 8

[augmentation]
enabled = false

[query]
near_m = 4.0
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return learnt_world(tmp_path_factory.mktemp("world"), frames=3, images=False)


def test_settings_come_from_a_file_and_words_win_over_it(world: Store, tmp_path: Path) -> None:
    file = tmp_path / "train.toml"
    file.write_text(CONFIG)
    command = ("train", "detector", "--store", world.url, "--config", file)
    run = done(*command, "--set", "steps=1", "--set", "network.head_width=4", "--json")
    assert run.json["step"] == 1
    (row,) = (r for r in model_rows(world) if r["model_id"] == run.json["model_id"])
    settings = json.loads(row["settings"])
    assert settings["network"]["widths"] == [8, 8, 8]
    assert settings["network"]["head_width"] == 4
    assert settings["augmentation"]["enabled"] is False
    assert settings["query"] == {"near_m": "4.0"}


def test_the_readmes_file_of_settings_is_one(repository: Path, tmp_path: Path) -> None:
    readme = (repository / "README.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", readme, flags=re.DOTALL)
    file = tmp_path / "train.toml"
    file.write_text(text)
    recipe = plan_recipe("detector", read_toml(str(file)))
    assert recipe.loop.steps == 800
    assert set(recipe.parameters) <= set(re.findall(r"set variable (\w+)", recipe.query.text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps = ", "cannot read settings from"),
        ("step = 3", "unknown setting 'train.step': did you mean steps"),
        ("[netwrok]\ncell_m = 1", "unknown group 'netwrok'"),
        ('[network]\ncell_m = "fine"', "'fine' is no float"),
    ],
)
def test_a_wrong_file_of_settings_is_one_line(
    world: Store, tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "train.toml"
    file.write_text(text)
    assert message in refused("train", "detector", "--store", world.url, "--config", file)


def logged(file: Path) -> dict[str, list[int]]:
    """Steps by tag. A record: its length (8 bytes), a sum (4), an event's message, a sum (4)."""
    from tensorboardX.proto import event_pb2

    data, place = file.read_bytes(), 0
    steps: dict[str, list[int]] = {}
    while place < len(data):
        (length,) = struct.unpack_from("<Q", data, place)
        event = event_pb2.Event.FromString(data[place + 12 : place + 12 + length])
        for value in event.summary.value:
            steps.setdefault(value.tag, []).append(event.step)
        place += 16 + length
    return steps


def test_logs_are_event_files_and_never_in_the_store(world: Store, tmp_path: Path) -> None:
    words = {**TINY, "steps": "3", "seed": "5"}
    sets = [word for name, text in words.items() for word in ("--set", f"{name}={text}")]
    run = done("train", "detector", "--store", world.url, "--logs", tmp_path / "logs", *sets)
    assert "3 steps" in run.err
    (file,) = (tmp_path / "logs").iterdir()
    assert ".tfevents." in file.name
    assert not [path for path in digests(Path(world.url)) if "tfevents" in path]
    steps = logged(file)
    assert {"loss", "loss/center", "learning_rate", "frames_per_s"} <= set(steps)
    assert set(map(tuple, steps.values())) == {(1, 2, 3)}


def test_without_the_package_for_logs_one_line_names_the_extra(
    world: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    line = refused("train", "detector", "--store", world.url, "--logs", tmp_path / "logs")
    assert "tcrdata[logs]" in line


def learn_as(rank: int, port: int, url: str, out: str) -> None:
    """One of two processes, as `torchrun` starts them."""
    os.environ |= {
        "RANK": str(rank), "LOCAL_RANK": str(rank), "WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port),
    }  # fmt: skip
    made: list[Learner] = []

    class Watched(Learner):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            made.append(self)

    training.Learner = Watched
    recipe = plan_recipe("detector", {**TINY, "steps": "2", "batch": "1"})
    said: list[int] = []
    model, progress = run_training(
        open_store(url), recipe, selection_id=SELECTION, device="cpu",
        report=lambda report: said.append(report.step),
    )  # fmt: skip
    assert progress is not None
    values = [value.detach().numpy().tobytes() for value in made[0].averaged.parameters()]
    found = {"model": model.model_id, "losses": progress.losses, "said": said,
             "weights": hashlib.sha256(b"".join(values)).hexdigest()}  # fmt: skip
    Path(out).write_text(json.dumps(found))


def learn_side_by_side(port: int, url: str, files: list[str]) -> None:
    """Learn in as many processes as there are files; they share what is imported, and no more."""
    importlib.import_module("torch._dynamo")
    fork = multiprocessing.get_context("fork")
    processes = [
        fork.Process(target=learn_as, args=(rank, port, url, file))
        for rank, file in enumerate(files)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0] * len(files)


def test_two_processes_learn_one_model(world: Store, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    files = [tmp_path / f"{rank}.json" for rank in range(2)]
    spawn = multiprocessing.get_context("spawn")
    both = spawn.Process(target=learn_side_by_side, args=(port, world.url, [*map(str, files)]))
    both.start()
    both.join()
    assert both.exitcode == 0
    first, second = (json.loads(file.read_text()) for file in files)
    assert first["model"] == second["model"]
    assert first["weights"] == second["weights"], "gradients are shared"
    assert first["losses"] != second["losses"], "each learns from frames of its own"
    assert (first["said"], second["said"]) == ([1, 2], [])
    (row,) = (r for r in model_rows(world) if r["model_id"] == first["model"])
    assert (row["step"], row["finished"]) == (2, True)
    assert json.loads(row["settings"])["loop"]["processes"] == 2
