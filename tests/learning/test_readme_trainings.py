"""The README's trainings, and what comes of them: its commands in order, with less to do."""

from __future__ import annotations

from pathlib import Path

import torch
from forked_commands import run_forking
from kitti_tree import write_raw
from readme_blocks import blocks

from tcrdata.networks.raft import Settings, make_network

MODEL = (
    """$(tcrdata sql "select min(model_id) from models where kind = '{kind}'" """
    "--store kitti-store --csv | tail -1)"
)
LESS = {
    "clips=4": "clips=1,frames=12",
    "clips=3": "clips=1,frames=12",
    "--rounds 3": "--rounds 2 --set train.steps=1",
    "--round 3": "--round 2",
    "train detector": "train detector --set steps=1",
    "train flow": "train flow --set steps=1",
    "--set steps=400 --set scenes": "--set steps=1 --set scenes",
    "--selection ID": "--selection tabletop_moving",
    "model=ID": f"model={MODEL.format(kind='detector')}",
    "--flow raft": f"--flow raft --model {MODEL.format(kind='flow')}",
}


def test_the_longer_commands_run_on_less(repository: Path, tmp_path: Path) -> None:
    """Trainings of one step, on few frames; all but those that set up or need Blender."""
    readme = (repository / "README.md").read_text(encoding="utf-8")
    write_raw(tmp_path / "kitti", frames=12)
    (tmp_path / "train.toml").write_text(blocks(readme, "toml")[0], encoding="utf-8")
    network = make_network(Settings(size="small"))
    torch.save(network.state_dict(), tmp_path / "raft-small.pth")
    lines = [line for block in blocks(readme, "sh") for line in block.splitlines()]
    commands = [line for line in lines if line[:8] == "tcrdata " and "blender" not in line]
    script = "\n".join(["set -euo pipefail", *commands])
    for much, less in LESS.items():
        assert much in script
        script = script.replace(much, less)
    kitti = str(tmp_path / "kitti")
    result = run_forking(
        ["bash", "-c", script], tmp_path / "commands", tmp_path, KITTI=kitti, KITTI_LATER=kitti
    )
    assert result.returncode == 0, result.stderr
    assert len(commands) >= 13
    assert (tmp_path / "curves").is_dir()
