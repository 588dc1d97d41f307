"""Trainings: the same seed gives the same losses, also when killed and resumed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runs import done, refused
from learnt_worlds import SELECTION, TINY, label, learnt_world, select_by_hand

from tcrdata.errors import (
    ConflictError,
    FrameError,
    MissingEvidenceError,
    SettingsError,
    StoreError,
    TrainingError,
)
from tcrdata.learning import runs
from tcrdata.learning.checkpoints import model_rows, read_weights
from tcrdata.learning.devices import Place
from tcrdata.learning.runs import plan_recipe, run_training
from tcrdata.learning.stream import FrameStream
from tcrdata.learning.training import LoopSettings, Report, _batches, collated, one_cycle
from tcrdata.rules.selections import Selection
from tcrdata.store import Store
from tcrdata.trainings import learn, unheard_presets

SEGMENTER = {"steps": "2", "batch": "1", "workers": "0", "network.width": "8"}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return learnt_world(tmp_path_factory.mktemp("world"))


class Broken:
    """Samples of which the third cannot be read."""

    def __len__(self) -> int:
        return 8

    def __getitem__(self, number: int) -> dict[str, object]:
        if number == 3:
            raise FrameError("frame 3: no image")
        return {"key": str(number), "input": np.full(2, number, np.float32)}

    def column(self, name: str) -> list[object]:
        return [0] * len(self)

    def drives(self) -> np.ndarray:
        return np.zeros(len(self), np.int64)


def unchanged(sample: dict[str, object], _: np.random.Generator) -> dict[str, object]:
    return sample


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_what_a_loader_cannot_read_is_told_in_its_turn_and_words(workers: int) -> None:
    loop = LoopSettings(batch=1, workers=workers, seed=1)
    order = [str(number) for number in FrameStream(Broken(), seed=1)._order(0)]
    batches = _batches(Broken(), unchanged, loop, Place("cpu"), 0)
    before = order[: order.index("3")]
    assert [next(batches)["key"] for _ in before] == [[key] for key in before]
    with pytest.raises(FrameError, match=r"^frame 3: no image$"):
        next(batches)


def losses_of(store: Store, **changes: str) -> tuple[float, ...]:
    recipe = plan_recipe("detector", {**TINY, **changes})
    _, progress = run_training(store, recipe, selection_id=SELECTION)
    assert progress is not None
    return progress.losses


class KilledError(Exception):
    pass


def kill_at(step: int):
    def report(said: Report) -> None:
        if said.step == step:
            raise KilledError

    return report


def test_killed_and_resumed_gives_the_same_losses(tmp_path: Path) -> None:
    store = learnt_world(tmp_path)
    recipe = plan_recipe("detector", TINY)
    with pytest.raises(KilledError):
        run_training(store, recipe, selection_id=SELECTION, report=kill_at(3))
    (row,) = model_rows(store)
    assert (row["step"], row["finished"]) == (2, False)
    select_by_hand(store, "later", [])
    said: list[int] = []
    model, progress = run_training(
        store, recipe, selection_id=SELECTION, resume=True, report=lambda r: said.append(r.step)
    )
    assert progress is not None
    assert said == [3, 4, 5, 6]
    whole = learnt_world(tmp_path / "whole")
    assert progress.losses == losses_of(whole)
    (row,) = model_rows(store)
    assert (row["model_id"], row["step"], row["finished"]) == (model.model_id, 6, True)
    assert row["losses"] == list(progress.losses)
    assert (row["samples"], row["positives"], row["labels_round"]) == (5, 5, 1)
    assert json.loads(row["settings"])["network"]["cell_m"] == 0.5
    with pytest.raises(MissingEvidenceError, match="no part 'state'"):
        read_weights(store, model.model_id, "state")


def test_the_seed_makes_the_losses(world: Store) -> None:
    assert losses_of(world, seed="1") != losses_of(world, seed="2")


def test_how_frames_are_loaded_leaves_the_losses_as_they_are(tmp_path: Path) -> None:
    losses = losses_of(learnt_world(tmp_path / "a"), steps="3")
    assert losses_of(learnt_world(tmp_path / "b"), steps="3", workers="1") == losses


def test_a_finished_model_is_not_trained_again(world: Store) -> None:
    recipe = plan_recipe("detector", {**TINY, "seed": "7", "steps": "2"})
    first, _ = run_training(world, recipe, selection_id=SELECTION)
    again, progress = run_training(world, recipe, selection_id=SELECTION)
    assert (again.model_id, progress) == (first.model_id, None)


def test_a_segmenter_trains_on_images(world: Store) -> None:
    model, progress = run_training(
        world, plan_recipe("segmenter", SEGMENTER), selection_id=SELECTION
    )
    assert progress is not None
    assert (model.kind, progress.step) == ("segmenter", 2)
    assert np.isfinite(progress.losses).all()


def test_a_selection_without_positive_labels_teaches_nothing(tmp_path: Path) -> None:
    store = learnt_world(tmp_path, positive=False)
    with pytest.raises(MissingEvidenceError, match="no positive labels"):
        losses_of(store)


def test_a_loss_that_is_no_number_names_the_frames(tmp_path: Path) -> None:
    store = learnt_world(tmp_path)
    sequence = store.read("sequences")["sequence"][0].as_py()
    broken = [{**label(sequence, 3, 0, True), "length_m": float("inf")}]
    select_by_hand(store, "broken", broken)
    recipe = plan_recipe("detector", TINY)
    message = rf"step 1: the loss is not finite.*kitti/{sequence}/000003"
    with pytest.raises(TrainingError, match=message):
        run_training(store, recipe, selection_id="broken")


def test_nothing_to_resume_is_said(world: Store) -> None:
    recipe = plan_recipe("detector", {**TINY, "seed": "99"})
    with pytest.raises(MissingEvidenceError, match="no checkpoint of a detector"):
        run_training(world, recipe, selection_id=SELECTION, resume=True)


def test_a_gpu_that_is_not_there_is_said(world: Store) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    recipe = plan_recipe("detector", TINY)
    with pytest.raises(SettingsError, match="has no GPU"):
        run_training(world, recipe, selection_id=SELECTION, device="cuda")
    with pytest.raises(SettingsError, match="is no device"):
        run_training(world, recipe, selection_id=SELECTION, device="toaster")


def test_a_snapshot_that_lacks_a_table_is_refused(world: Store) -> None:
    world.freeze("frames-alone", ["frames", "sequences"])
    recipe = plan_recipe("detector", TINY)
    with pytest.raises(StoreError, match="frames-alone does not cover table images"):
        run_training(world, recipe, selection_id=SELECTION, snapshot="frames-alone")


@pytest.mark.parametrize(
    ("assignments", "message"),
    [
        ({"step": "3"}, "unknown setting 'train.step': did you mean steps"),
        ({"netwrok.widths": "8"}, "unknown group 'netwrok'"),
        ({"network": "pyramid"}, "network pyramid is a segmenter, not a detector"),
        ({"network": "transformer"}, "no networks named 'transformer'"),
        ({"steps": "many"}, "'many' is no int"),
        ({"query": "segments"}, "no training query 'segments'"),
    ],
)
def test_wrong_settings_are_named(assignments: dict[str, str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        plan_recipe("detector", assignments)


def test_the_rate_rises_and_falls() -> None:
    rates = [one_cycle(share, 0.1) for share in (0.0, 0.05, 0.1, 0.5, 0.999)]
    assert rates[0] < rates[1] < rates[2] == pytest.approx(1.0)
    assert rates[2] > rates[3] > rates[4]
    assert rates[4] < 0.01


def test_the_commands_train_and_show_models(tmp_path: Path) -> None:
    store = learnt_world(tmp_path)
    sets = [part for name, text in TINY.items() for part in ("--set", f"{name}={text}")]
    assert "no model yet" in done("models", "--store", store.url).err
    run = done("train", "detector", "--store", store.url, "--json", *sets)
    assert run.json["step"] == 6
    assert "5 frames and 5 positive labels, 6 steps" in run.err
    assert "nothing to do" in done("train", "detector", "--store", store.url, *sets).err
    (shown,) = done("models", "--store", store.url, "--json").json
    assert shown["model_id"] == run.json["model_id"]
    assert (shown["labels"], shown["finished"]) == (SELECTION, True)
    assert shown["settings"]["loop"]["steps"] == 6
    assert shown["model_id"] in done("models", "--store", store.url).out
    line = refused("train", "detector", "--store", store.url, "--selection", "nobody", *sets)
    assert "no selection 'nobody'" in line


def test_a_training_that_would_take_parked_cars_for_background_says_so(world: Store) -> None:
    assert unheard_presets(world, SELECTION) == []
    select_by_hand(world, "motion", [], preset="tcrdata")
    assert unheard_presets(world, "motion") == ["tcrdata_static"]


def test_samples_of_two_sizes_make_no_step() -> None:
    samples = [{"input": np.zeros(size, np.float32)} for size in (2, 3)]
    with pytest.raises(SettingsError, match=r"input: \(2,\) and \(3,\)\): give batch=1"):
        collated(samples, "cpu")


@pytest.mark.parametrize("finished", [True, False])
def test_a_build_goes_on_with_what_another_has_finished_meanwhile(
    world: Store, monkeypatch: pytest.MonkeyPatch, finished: bool
) -> None:
    recipe = plan_recipe("detector", {**TINY, "seed": "8" if finished else "9"})
    labels = Selection(SELECTION, "hand", "hand", 1, "", 0, 0, 0, True)

    def overtaken(store: Store, *arguments: object, **named: object) -> None:
        if finished:
            run_training(store, *arguments, **named)
        raise ConflictError("another training has finished it meanwhile")

    monkeypatch.setattr(runs, "run_training", overtaken)
    if finished:
        assert learn(world, recipe, labels, lambda *_: None).state == "done"
        return
    with pytest.raises(ConflictError, match="meanwhile"):
        learn(world, recipe, labels, lambda *_: None)
