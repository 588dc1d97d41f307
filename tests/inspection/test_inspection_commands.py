"""`why`, `rules` and `test-rules` as people call them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_runs import done, refused, run
from rule_worlds import GOOD_TRACK, put_tracks

from tcrdata.rules import select
from tcrdata.store import open_store


@pytest.fixture
def store(tmp_path: Path) -> str:
    made = open_store(str(tmp_path / "store"), create=True)
    put_tracks(made, "s1", [GOOD_TRACK, {**GOOD_TRACK, "travel_m": 2.4, "age_frames": 5}])
    select(made, "tcrdata")
    return made.url


def test_why_says_which_rule_decides_and_the_command_that_accepts(store: str) -> None:
    told = done("why", "d/s1/000001", "--store", store)
    assert "stopped by travels alone: travels 2.4 m, needs >= 3 m" in told.out
    assert "--set min_travel_m=2.4" in told.err
    changed = ("--set", "min_travel_m=2.9", "--set", "min_points=6")
    done("check", "--store", store, *changed)
    told = done("why", "d/s1/000001", "--store", store)
    assert "--set min_points=6 --set min_travel_m=2.4 --name changed" in told.err


def test_why_json_names_the_place_taken(store: str) -> None:
    found = done("why", "--frame", 0, "--at", "0,10", "--store", store, "--json").json
    assert found["nearest"][0]["proposal_id"] == found["proposal"]["proposal_id"]
    assert [rule["rule"] for rule in found["rules"]][:2] == ["source", "travels"]


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--frame", 0),
        ("d/s1/000009",),
        ("d/s1/000000", "--frame", 0, "--at", "1,2"),
        ("d/s1/000000", "--selection", "none"),
        ("--frame", 0, "--at", "here"),
    ],
)
def test_why_refuses_what_names_no_proposal(store: str, arguments: tuple[object, ...]) -> None:
    refused("why", *arguments, "--store", store)


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A generated drive with pictures, and a selection of a few labels."""
    store = str(tmp_path_factory.mktemp("demo") / "store")
    done("build", "--dataset", "demo", "--store", store, "--root", "seed=1,frames=6")
    loose = ("min_core_share=0", "min_box_core_share=0", "min_travel_m=0.01", "min_age_frames=2")
    done("check", "--store", store, "--name", "loose", *(f"--set={value}" for value in loose))
    return store


def test_why_draws_the_proposal_its_place_and_its_margins(demo: str, tmp_path: Path) -> None:
    labels = done("sql", "select proposal_id from labels order by 1", "--store", demo, "--json")
    asked = labels.json[0]["proposal_id"]
    told = done("why", asked, "--store", demo, "--png", tmp_path / "label.png")
    assert f"drawn: {tmp_path / 'label.png'}" in told.err
    image = cv2.imread(str(tmp_path / "label.png"))
    assert image is not None
    assert image.shape[0] > 800
    assert image.shape[1] > 1200
    colours = np.unique(image.reshape(-1, 3), axis=0)
    assert len(colours) > 1000, "a camera image is in it"
    message = refused("why", asked, "--store", demo, "--png", tmp_path / "no" / "folder.png")
    assert "--png" in message


def test_a_frozen_store_is_built_on_and_exported(demo: str, tmp_path: Path) -> None:
    done("snapshot", "frozen", "--store", demo)
    out = tmp_path / "out"
    done("export", "kitti-tracking", "--store", demo, "--snapshot", "frozen", "--out", out)
    assert any(path.read_text() for path in out.rglob("*.txt"))
    root = ("--root", "seed=1,frames=6")
    again = done("build", "--dataset", "demo", "--store", demo, *root, "--snapshot", "frozen")
    assert "all 7 units were done already" in again.err


def test_rules_tells_the_presets_values() -> None:
    told = done("rules", "--preset", "paper", "--json").json
    cycle = next(rule for rule in told["rules"] if rule["rule"] == "cycle_error")
    assert cycle["required"] is True
    assert cycle["parameters"][0]["unit"] == "m"
    assert "eq. 6, 7" in cycle["source"]
    refused("rules", "--preset", "none")


def test_test_rules_fails_with_what_was_expected_and_found(tmp_path: Path) -> None:
    (tmp_path / "range.toml").write_text(
        '[[case]]\nname = "near"\ngiven.proposals = [{ range_m = 1.0 }]\n'
        "expected = [{ value = 1.0, bound = 4.0, passed = true }]\n"
    )
    refused("test-rules", tmp_path)
    (tmp_path / "rules").mkdir()
    rule = Path(__file__).parents[2] / "queries" / "rules" / "range.sql"
    text = rule.read_text().replace("min_range_m", "own_range_m")
    (tmp_path / "rules" / "own_range.sql").write_text(text)
    (tmp_path / "cases").mkdir()
    (tmp_path / "range.toml").rename(tmp_path / "cases" / "own_range.toml")
    failed = run("test-rules", tmp_path)
    assert failed.code == 1
    assert "own_range, case 'near', proposal 1: passed is false, expected true" in failed.out
    assert f"then tcrdata test-rules {tmp_path}" in failed.err
    case = tmp_path / "cases" / "own_range.toml"
    case.write_text(case.read_text().replace("passed = true", "passed = false"))
    assert (
        f"next: tcrdata check --store STORE --preset {tmp_path}/"
        in done("test-rules", tmp_path).err
    )
