"""The README's commands run, in order, and its lists are complete."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from forked_commands import run_forking
from kitti_tree import write_raw
from readme_blocks import blocks

from tcrdata.rules import load_rules, preset_names
from tcrdata.store import schemas


@pytest.fixture(scope="module")
def readme(repository: Path) -> str:
    return (repository / "README.md").read_text(encoding="utf-8")


def test_every_command_runs(readme: str, tmp_path: Path) -> None:
    """In one shell that stops at the first failure, on a small generated KITTI drive."""
    write_raw(tmp_path / "kitti", frames=12)
    script = "set -euo pipefail\n" + "\n".join(blocks(readme, "bash"))
    result = run_forking(
        ["bash", "-c", script], tmp_path / "commands", tmp_path, KITTI=str(tmp_path / "kitti")
    )
    assert result.returncode == 0, result.stderr
    assert "nothing to do" in result.stderr
    assert list((tmp_path / "labels" / "label_02").glob("*.txt"))
    assert len(list((tmp_path / "pictures").glob("*.png"))) >= 2


def test_make_demo_builds_scores_and_draws(repository: Path, tmp_path: Path) -> None:
    """All but the setup, on a few frames."""
    commands = tmp_path / "commands"
    values = [f"BIN={commands}", f"DEMO={tmp_path / 'demo'}", "FRAMES=0-5"]
    make = ["make", "--old-file=setup", "demo", *values]
    result = run_forking(make, commands, repository)
    assert result.returncode == 0, result.stderr
    assert "recall, all" in result.stdout
    assert f"next: {commands}/tcrdata sql" in result.stdout
    assert len(list((tmp_path / "demo" / "pictures").glob("*.png"))) >= 5


@pytest.mark.parametrize("target", ["setup", "demo", "test"])
def test_the_make_targets_are_there(readme: str, repository: Path, target: str) -> None:
    assert f"make {target}" in readme
    result = subprocess.run(
        ["make", "--dry-run", target], cwd=repository, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr


def test_tables_presets_and_rules_are_all_listed(readme: str) -> None:
    for name in (*schemas.table_names(), *preset_names(), *load_rules()):
        assert f"`{name}`" in readme, name


def test_the_rule_it_shows_is_a_rule(readme: str, tmp_path: Path) -> None:
    folder = tmp_path / "rules"
    folder.mkdir()
    (folder / "seen_points.sql").write_text(blocks(readme, "sql")[0], encoding="utf-8")
    (parameter,) = load_rules(folder)["seen_points"].parameters
    assert (parameter.name, parameter.literal) == ("min_seen_points", "20")


def test_the_pictures_are_there(readme: str, repository: Path) -> None:
    for path in re.findall(r"\]\((docs/[^)]+)\)", readme):
        assert (repository / path).is_file()
