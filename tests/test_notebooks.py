"""The notebooks run from top to bottom, draw something, and are kept without their outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest
from forked_commands import forked_commands
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(path.name for path in FOLDER.glob("*.ipynb"))
# Those of one group share a folder, and so the store that the first of them builds.
GROUPS = (NOTEBOOKS[:3], NOTEBOOKS[3:])
# What takes a reader a minute goes here just far enough to detect and draw something.
SHORTER = {
    "steps=120": "steps=30",
    "build --dataset demo": "build --dataset demo --frames 0-24",
    "frames=60": "frames=25",
    "frames=24": "frames=12",
}


def opened(name: str) -> Any:
    return nbformat.read(FOLDER / name, as_version=4)


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def pictures(notebook: Any) -> int:
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    return sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("names", GROUPS, ids=["tabletop", "street"])
def test_they_run_and_draw(
    names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = tmp_path / "commands"
    commands.mkdir()
    with forked_commands(commands) as path:
        monkeypatch.setenv("PATH", path)
        for name in names:
            notebook = opened(name)
            for cell in code_cells(notebook):
                for long, short in SHORTER.items():
                    cell.source = cell.source.replace(long, short)
            folder = {"metadata": {"path": str(tmp_path)}}
            NotebookClient(notebook, timeout=600, kernel_name="python3", resources=folder).execute()
            assert pictures(notebook) >= 1, name


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_outputs_are_stripped(name: str) -> None:
    """`make fix` strips them."""
    for cell in code_cells(opened(name)):
        assert cell.outputs == []
        assert cell.execution_count is None
        assert "execution" not in cell.metadata


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_they_name_no_place_of_one_machine(name: str) -> None:
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert '"name": "python3"' in text
    for place in ("/work", "/home", "/tmp", "/Users", "C:\\\\"):
        assert place not in text
