"""The command line, command by command, on a small generated KITTI folder."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import duckdb
import pytest
from cli_runs import Run, done
from kitti_tree import DRIVE, SEQUENCE, write_raw, write_tracking
from store_files import digests

from tcrdata import __version__
from tcrdata.cli.overview import overview
from tcrdata.resources import resource_folder

FRAMES = 12
COMMANDS = ("build", "check", "sql", "evaluate", "export", "status", "draw", "views", "warm")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    return folder


@pytest.fixture(scope="module")
def built(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    store = tmp_path_factory.mktemp("built") / "store"
    options = ("--preset", "paper,tcrdata", "--workers", 1, "--json")
    return store, done("build", "--dataset", "kitti", "--root", root, "--store", store, *options)


@pytest.fixture(scope="module")
def store(built: tuple[Path, Run]) -> Path:
    return built[0]


def rows(store: Path, query: str) -> list[dict[str, object]]:
    found: list[dict[str, object]] = done("sql", query, "--store", store, "--json").json
    return found


def test_build_reports_units_times_and_selections(built: tuple[Path, Run]) -> None:
    report = built[1].json
    assert report["made"] == len(report["units"]) == 11
    assert report["failed"] == report["skipped"] == report["done"] == 0
    assert {unit["state"] for unit in report["units"]} == {"made"}
    assert {unit["sequence"] for unit in report["units"]} == {DRIVE}
    assert 0 < sum(unit["seconds"] for unit in report["units"]) <= report["seconds"]
    assert [s["name"] for s in report["selections"]] == ["paper", "tcrdata"]
    assert all(s["labels"] > 0 for s in report["selections"])


def test_a_second_build_says_that_there_is_nothing_to_do(root: Path, store: Path) -> None:
    before = digests(store, "data", "commits")
    options = ("--preset", "paper,tcrdata", "--workers", 1)
    result = done("build", "--dataset", "kitti", "--root", root, "--store", store, *options)
    assert "nothing to do: all 11 units were done already" in result.err
    assert result.out.count("selection ") == 2
    assert digests(store, "data", "commits") == before


def test_a_dry_run_lists_what_is_to_do_and_writes_nothing(
    root: Path, store: Path, tmp_path: Path
) -> None:
    command = ("build", "--dataset", "kitti", "--root", root, "--dry-run")
    result = done(*command, "--store", tmp_path / "none")
    assert "7 of 7 units to make" in result.err
    assert all(stage in result.out for stage in ("frames", "ground_truth", "odometry", "tracks"))
    assert not (tmp_path / "none").exists()
    assert done(*command, "--store", store, "--json").json["done"] == 7
    both = done(*command, "--store", store, "--preset", "release,tcrdata", "--json").json
    assert {unit["stage"] for unit in both["units"] if unit["state"] == "todo"} == {
        "regions_release"
    }


def test_build_takes_settings_from_a_file_and_from_the_command_line(
    root: Path, tmp_path: Path
) -> None:
    settings = tmp_path / "mine.toml"
    settings.write_text("min_travel_m = 2.5\n[free_space]\nmargin_m = 0.3\n")
    store = tmp_path / "store"
    options = ["--frames", "0-3", "--sequences", DRIVE, "--workers", 2, "--rounds", 1]
    options += ["--config", settings, "--set", "free_space.margin_m=0.35"]
    options += ["--set", "max_cycle_error_m=0.125"]
    done("build", "--dataset", "kitti", "--root", root, "--store", store, *options)
    (ran,) = rows(store, "select settings from runs")
    plan = json.loads(str(ran["settings"]))
    assert plan["settings"]["free_space"]["margin_m"] == 0.35
    assert plan["parameters"] == {"max_cycle_error_m": "0.125", "min_travel_m": "2.5"}
    (used,) = rows(store, "select parameters from selections")
    assert "0.125" in str(used["parameters"])
    assert rows(store, "select count(*) as n from frames") == [{"n": 4}]


def test_the_tracking_layout_is_found_by_looking(tmp_path: Path) -> None:
    write_tracking(tmp_path / "kitti", frames=6)
    store = tmp_path / "store"
    root = tmp_path / "kitti"
    done("build", "--dataset", "kitti", "--root", root, "--store", store, "--workers", 1)
    assert rows(store, "select distinct sequence from ground_truth") == [{"sequence": SEQUENCE}]
    done("export", "kitti-tracking", "--store", store, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "label_02" / f"{SEQUENCE}.txt").is_file()


def test_check_selects_again_by_name(store: Path) -> None:
    default = done("check", "--store", store, "--preset", "paper", "--json").json
    options = ("--set", "max_cycle_error_m=0.0001", "--name", "strict")
    before = digests(store, "data")
    result = done("check", "--store", store, "--preset", "paper", *options)
    assert "'strict': 0 labels and " in result.out
    new = set(digests(store, "data")) - set(before)
    assert {path.split("/")[1] for path in new} == {"selections", "labels"}
    status = done("status", "--store", store, "--json").json
    assert {"paper", "tcrdata", "strict"} <= {s["name"] for s in status["selections"]}
    failed = rows(
        store,
        "select rule, count(*) as n from checks where selection = 'strict' and passed is false "
        "group by all order by n desc",
    )
    assert failed[0]["rule"] == "cycle_error"
    again = done("check", "--store", store, "--preset", "paper", "--json").json
    assert again == default


def test_sql_prints_a_table_json_or_csv(store: Path) -> None:
    query = "select frame, has_image, error, 0.5 as half from frames order by frame limit 2"
    table = done("sql", query, "--store", store).out
    assert all(word in table for word in ("frame", "has_image", "true", "0.5"))
    first = {"frame": 0, "has_image": True, "error": None, "half": "0.5"}
    assert rows(store, query) == [first, {**first, "frame": 1}]
    text = done("sql", query, "--store", store, "--csv").out
    assert list(csv.reader(io.StringIO(text))) == [
        ["frame", "has_image", "error", "half"], ["0", "True", "", "0.5"], ["1", "True", "", "0.5"],
    ]  # fmt: skip


def test_a_reader_that_closes_early_is_no_error(store: Path) -> None:
    query = "select proposal_id, p.* from proposals p, range(100)"
    command = [sys.executable, "-m", "tcrdata", "sql", query, "--store", str(store), "--csv"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        assert child.stdout.readline().startswith("proposal_id,")
        child.stdout.close()
        assert child.stderr.read() == ""
        assert child.wait() == 141


def test_evaluate_prints_the_protocol_then_the_scores(store: Path) -> None:
    text = done("evaluate", "--store", store, "--selection", "paper").out
    assert text.startswith("Predictions: labels in state positive")
    assert all(word in text for word in ("recall, all", "recall, moving", "precision", "2d"))
    moving = done("evaluate", "--store", store, "--selection", "paper", "--moving-only").out
    assert "recall, moving" in moving
    assert "recall, all" not in moving
    scores = done("evaluate", "--store", store, "--selection", "paper", "--json").json
    assert "protocol" in scores
    assert "NaN" not in json.dumps(scores)
    scored = "select distinct name from selections join metrics using (selection_id)"
    assert {"name": "paper"} in rows(store, scored)


def test_export_writes_one_line_a_label(store: Path, tmp_path: Path) -> None:
    command = ("export", "kitti-tracking", "--store", store, "--selection", "paper")
    (paper,) = rows(store, "select labels from selections where name = 'paper'")
    result = done(*command, "--out", tmp_path / "out")
    assert "score last" in result.out
    lines = (tmp_path / "out" / "label_02" / f"{DRIVE}.txt").read_text().splitlines()
    assert len([line for line in lines if " DontCare " not in line]) == paper["labels"]
    assert {len(line.split()) for line in lines} == {18}
    done(*command, "--out", tmp_path / "out", "--overwrite")
    card = done(*command, "--out", tmp_path / "other", "--json").json
    assert card["labels"] == paper["labels"]


def test_export_without_a_selection_takes_the_newest(store: Path, tmp_path: Path) -> None:
    for number, name in enumerate(("tcrdata", "paper", "tcrdata")):
        done("check", "--store", store, "--preset", name)
        (newest,) = rows(store, f"select labels from selections where name = '{name}'")
        out = tmp_path / str(number)
        card = done("export", "kitti-tracking", "--store", store, "--out", out, "--json").json
        assert card["labels"] == newest["labels"]


def test_status_counts_units_rows_and_bytes(store: Path) -> None:
    text = done("status", "--store", store).out
    assert all(word in text for word in ("units", "missing", "proposals", "paper"))
    status = done("status", "--store", store, "--json").json
    assert status["units"]["failed"] == status["units"]["missing"] == 0
    assert status["problems"] == []
    on_disk: Counter[str] = Counter()
    for path in (store / "data").rglob("*.parquet"):
        on_disk[path.relative_to(store).parts[1]] += path.stat().st_size
    del on_disk["metrics"]  # scored twice, and the newest counts
    assert {row["table"]: row["bytes"] for row in status["tables"]}.items() >= on_disk.items()
    counted = {row["table"]: row["rows"] for row in status["tables"]}
    assert rows(store, "select count(*) as n from proposals") == [{"n": counted["proposals"]}]


def test_draw_writes_pictures_of_the_frames_asked_for(store: Path, tmp_path: Path) -> None:
    options = ("--frames", "2", "--sequence", DRIVE, "--selection", "paper")
    result = done("draw", "--store", store, "--out", tmp_path / "a", *options)
    paths = [Path(line) for line in result.out.splitlines()]
    assert [path.name for path in paths[:2]] == [f"{DRIVE}-000002.png", f"{DRIVE}-000002-flow.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    done("draw", "--store", store, "--out", tmp_path / "b", *options, "--no-truth")
    name = paths[0].name
    assert (tmp_path / "b" / name).read_bytes() != (tmp_path / "a" / name).read_bytes()


def test_views_let_a_plain_shell_run_rules_as_they_are(store: Path) -> None:
    statements = done("views", "--store", store).out
    rule = resource_folder("queries") / "rules" / "enough_points.sql"
    with duckdb.connect() as shell:
        shell.execute(statements)
        verdicts = shell.execute(rule.read_text()).fetchall()
        stored = rows(store, "select count(*) as n from proposals")
        assert [{"n": len(verdicts)}] == stored
        counts = "select selection, rule, passed, count(*) as n from checks group by all "
        counts += "order by all"
        cursor = shell.execute(counts)
        names = [column[0] for column in cursor.description]
        in_shell = [dict(zip(names, row, strict=True)) for row in cursor.fetchall()]
    assert in_shell == rows(store, counts)
    assert in_shell


def test_help_names_every_command_and_loads_nothing_that_is_slow() -> None:
    command = [sys.executable, "-X", "importtime", "-m", "tcrdata", "--help"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    assert all(command in shown.stdout for command in COMMANDS)
    lines = shown.stderr.splitlines()
    assert all(line.startswith("import time:") for line in lines)
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in lines}
    assert "tcrdata" in loaded
    assert not loaded & {"cyclopts", "rich"}
    assert not loaded & {"numpy", "duckdb", "pyarrow", "polars", "fsspec", "torch", "cv2", "numba"}


def test_help_is_what_the_parser_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    drawn = done("--help").out  # into no encoding known: the parser's
    assert overview().splitlines() == [line.rstrip() for line in drawn.splitlines()]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str) -> None:
    text = done(command, "--help").out
    assert text.startswith(f"Usage: tcrdata {command}")
    assert ("--store" in text) is (command != "warm")


def test_the_version_is_the_packages() -> None:
    assert done("--version").out.strip() == __version__


def test_without_a_command_it_says_what_there_is() -> None:
    assert "Commands" in done().out
