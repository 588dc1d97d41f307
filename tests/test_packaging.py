"""The wheel carries the SQL, and what it needs is what the README says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from email import message_from_string
from pathlib import Path

import pytest

SCRIPT = """
import tcrdata
from tcrdata.cli import main
from tcrdata.resources import resource_files
from tcrdata.rules import load_rules, preset_names
from tcrdata.store.schemas import table_names

print(tcrdata.__file__)
print(*load_rules())
print(*preset_names())
print(*table_names())
print(*(path.stem for path in resource_files("queries/reports/*.sql")))
"""


@pytest.fixture(scope="module")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*command, str(repository)], check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


def stems(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.glob("*.sql"))


def test_the_wheel_has_every_sql_file_and_case_of_the_checkout(
    wheel: Path, repository: Path
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        shipped = {
            name: archive.read(name)
            for name in archive.namelist()
            if name.endswith((".sql", ".toml"))
        }
    here = {
        f"tcrdata/{path.relative_to(repository).as_posix()}": path.read_bytes()
        for folder in ("schemas", "queries")
        for path in (repository / folder).rglob("*.*")
    }
    assert shipped == here
    assert len(here) > 40


def test_the_wheel_has_every_module_the_licence_and_no_test(wheel: Path, repository: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    modules = {
        path.relative_to(repository).as_posix() for path in (repository / "tcrdata").rglob("*.py")
    }
    assert {name for name in names if name.endswith(".py")} == modules
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_an_unpacked_wheel_finds_its_sql(wheel: Path, repository: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "zipfile", "-e", str(wheel), str(tmp_path)]
    subprocess.run(command, check=True)
    shown = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    where, *lists = shown.stdout.splitlines()
    assert Path(where).is_relative_to(tmp_path)
    folders = ("queries/rules", "queries/presets", "schemas", "queries/reports")
    found = [sorted(line.split()) for line in lists]
    assert found == [stems(repository / folder) for folder in folders]


def test_torch_is_needed_for_training_alone(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith("METADATA")]
        metadata = message_from_string(archive.read(name).decode())
    needed = metadata.get_all("Requires-Dist", [])
    torch = [text for text in needed if text.startswith("torch")]
    assert torch == ["torch>=2.6; extra == 'dev'", "torch>=2.6; extra == 'train'"]


def test_every_dependency_has_a_tested_version(repository: Path) -> None:
    lines = (repository / "constraints.txt").read_text().splitlines()
    pinned = [line.partition("==") for line in lines if line and not line.startswith("#")]
    assert all(version for _, _, version in pinned)
    assert "torch==2.13.0" in lines

    def plain(name: str) -> str:
        return re.sub(r"[-_.]+", "-", name).lower()

    names = [plain(name) for name, _, _ in pinned]
    assert len(names) == len(set(names))
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    assert {plain(re.split(r"[<>=]", text)[0]) for text in wanted} <= set(names)
