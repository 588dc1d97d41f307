"""What is asked for and is not there gets one clear line and a non-zero exit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from cli_runs import build_command, done, refused, run
from kitti_tree import (
    DRIVE,
    write_raw,
)
from store_files import digests

from tcrdata.errors import SettingsError
from tcrdata.store import open_store
from tcrdata.store.schemas import SCHEMA_VERSION

FRAMES = 10
RULE = (
    "-- It is near.\n-- source: none\n-- needs: value <= most_m\n-- cues:\n"
    "set variable most_m = 5.5;  -- m: distance\n"
    "select p.proposal_id, {columns}\nfrom proposals p\n"
)
PRESET = (
    "-- Mine.\n-- rules: {rules}\n-- required:\n-- cues: tracks\n"
    "select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p\n"
)
COLUMNS = "p.range_m as value, 1::double as bound, p.range_m < getvariable('most_m') as passed"


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_raw(folder, frames=FRAMES)
    return folder


@pytest.fixture(scope="module")
def store(intact: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built") / "store"
    done(*build_command(intact, folder))
    return folder


@pytest.mark.parametrize(
    ("root", "message"),
    [
        ("absent", "absent' is not a folder: give the folder that holds KITTI"),
        ("file.txt", "file.txt' is not a folder"),
        (".", "is not KITTI: found neither <date>/<drive>_sync/velodyne_points (raw) nor"),
        ("", "KITTI needs a root"),
    ],
)
def test_a_root_that_is_not_kitti(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, root: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("no data")
    assert message in refused(*build_command(root, tmp_path / "store"))
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--preset", "tcr"), "no preset 'tcr'; there are detector, "),
        (("--preset", ""), "no preset named: there are detector"),
        (("--set", "max_cycle_eror_m=1"), "unknown parameter 'max_cycle_eror_m': did you mean"),
        (("--set", "max_cycle_error_m=far"), "max_cycle_error_m must be a number, not 'far'"),
        (("--set", "free_space.margn_m=1"), "unknown setting 'free_space.margn_m': did you mean"),
        (("--set", "free_space.margin_m=far"), "free_space.margin_m: 'far' is no float"),
        (("--set", "fre_space.margin_m=1"), "unknown cue 'fre_space'"),
        (("--set", "margin"), "'margin' is no setting: write NAME=VALUE"),
        (("--config", "absent.toml"), "cannot read settings from absent.toml"),
        (("--sequences", "nowhere"), f"no sequence nowhere; there are {DRIVE}"),
        (("--sequences", ""), f"no sequence named; there are {DRIVE}"),
        (("--frames", "9-3"), "--frames '9-3': '9-3' is no range; write such as 0-49"),
        (("--rounds", 0), "--rounds 0"),
        (("--workers", 0), "--workers 0: at least one is needed"),
        (("--workers", "many"), 'Invalid value for --workers: unable to convert "many"'),
        (("--dataset", "kity"), "no datasets named 'kity': there are cater, demo, kitti, street"),
        (("--colour", "red"), "--colour"),
    ],
)
def test_a_build_that_asks_for_what_there_is_not(
    intact: Path, tmp_path: Path, options: tuple[object, ...], message: str
) -> None:
    command = dict(zip(("--workers", "--dataset"), (1, "kitti"), strict=True))
    command |= dict(zip(options[::2], options[1::2], strict=True))  # type: ignore[arg-type]
    given = [part for pair in command.items() for part in pair]
    line = refused("build", "--root", intact, "--store", tmp_path / "store", *given)
    assert message in line
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("check", "--preset", "papr"), "no preset 'papr'; there are detector"),
        (("check", "--set", "min_travl_m=1"), "no parameter 'min_travl_m'; near: min_travel"),
        (("check", "--set", "min_travel_m=far"), "min_travel_m must be a number, not 'far'"),
        (("check", "--preset", "paper"), f"regions_paper, which kitti/{DRIVE} lacks; run `tcrdata"),
        (("sql", "selec 1"), 'syntax error at or near "selec" (line 1 of the query)'),
        (("sql", " "), "the query is empty"),
        (("sql", "from propsals"), 'propsals does not exist! Did you mean "proposals"?'),
        (("sql", "from propsals", "--json"), 'Did you mean "proposals"?'),
        (("sql", "select source::int from proposals"), "Could not convert string"),
        (("sql", "select source::int from proposals", "--csv"), "Could not convert string"),
        (("sql", "select 1", "--json", "--csv"), "--json and --csv: choose one"),
        (("evaluate", "--selection", "best"), "no selection 'best'; there are: tcrdata"),
        (
            ("export", "cooc", "--out", "out"),
            "no exporters named 'cooc': there are coco, kitti, kitti_",
        ),
        (("export", "kitti", "--out", "out", "--where", "score >"), "syntax error at or near"),
        (("export", "kitti", "--out", "out", "--where", "drop table labels"), "a statement (drop)"),
        (("export", "kitti", "--out", "out", "--ignore", "maybe"), "maybe"),
        (("export", "kitti", "--out", "out", "--selection", "best"), "no selection 'best'; there"),
        (("export", "kitti-tracking", "--out", "full"), "full is not empty: choose another --out"),
        (("export", "kitti-tracking", "--out", "full/file"), "file cannot be made a folder"),
        (("draw", "--out", "full/file"), "--out full/file: File exists: give another folder"),
        (("draw", "--out", "out", "--frames", "99"), "--frames 99: "),
        (("draw", "--out", "out", "--sequence", "a"), f"no sequence 'a'; there are: {DRIVE}"),
    ],
)
def test_a_command_that_asks_for_what_there_is_not(
    store: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    assert message in refused(*command, "--store", store)


@pytest.mark.parametrize(
    ("columns", "rules", "message"),
    [
        (COLUMNS.replace("as value", "as val"), "near", "rules/near.sql:6: the select gives"),
        (COLUMNS.replace("1::double", "'1'"), "near", "column bound is VARCHAR, it must be DOUBLE"),
        (COLUMNS.replace("p.range_m as", "p.rnge_m as"), "near", "rnge_m"),
        (COLUMNS, "nearest", "mine.sql:1: no rule 'nearest'; there are"),
    ],
)
def test_a_rule_file_of_ones_own_that_is_wrong(
    store: Path, tmp_path: Path, columns: str, rules: str, message: str
) -> None:
    (tmp_path / "rules").mkdir()
    (tmp_path / "rules" / "near.sql").write_text(RULE.format(columns=columns))
    (tmp_path / "mine.sql").write_text(PRESET.format(rules=rules))
    before = digests(store)
    assert message in refused("check", "--store", store, "--preset", tmp_path / "mine.sql")
    assert digests(store) == before


@pytest.mark.parametrize(
    "command",
    [
        ("check",),
        ("sql", "select 1"),
        ("evaluate",),
        ("export", "kitti-tracking", "--out", "out"),
        ("status",),
        ("draw", "--out", "out"),
        ("views",),
    ],
)
def test_no_store_or_one_of_another_version(tmp_path: Path, command: tuple[str, ...]) -> None:
    where = tmp_path / "store"
    assert "there is no store at" in refused(*command, "--store", where)
    where.mkdir()
    (where / "store.json").write_text('{"schema_version": 99}')
    line = refused(*command, "--store", where)
    assert f"version 99, this tcrdata reads {SCHEMA_VERSION}: build into a new store" in line


def test_a_build_into_a_store_of_another_version_or_a_folder_in_use(
    intact: Path, tmp_path: Path
) -> None:
    (tmp_path / "store.json").write_text('{"schema_version": 99}')
    assert "has schema version 99" in refused(*build_command(intact, tmp_path))
    assert "is not a store and not empty" in refused(*build_command(intact, intact))
    (tmp_path / "file").touch()
    assert "is not a store and not empty" in refused(*build_command(intact, tmp_path / "file"))
    assert "there is no store at" in refused("status", "--store", tmp_path / "file")
    line = refused(*build_command(intact, "nowhere://store"))
    assert "not a place for a store: Protocol not known" in line


def test_views_are_for_local_folders() -> None:
    open_store("memory://bad-input", create=True)
    assert "local folder" in refused("views", "--store", "memory://bad-input")


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    with pytest.raises(SettingsError):
        run("build", "--dataset", "kity", "--store", tmp_path, "--debug")
    command = [sys.executable, "-m", "tcrdata", "status", "--store", str(tmp_path / "none")]
    plain = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (plain.returncode, plain.stderr.count("\n"), plain.stdout) == (1, 1, "")
    shown = subprocess.run([*command, "--debug"], capture_output=True, text=True, check=False)
    assert shown.returncode == 1
    assert "Traceback (most recent call last)" in shown.stderr
    assert "StoreError: there is no store at" in shown.stderr
