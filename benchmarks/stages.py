"""Seconds a frame by stage, peak memory and bytes a frame by table, for each preset.

    python benchmarks/stages.py
    python benchmarks/stages.py --dataset kitti --root ROOT --frames 0-49 --json

Each preset is built into a store of its own, by the command as anyone would type it. Times are wall
times; of several runs the best counts. Memory is that of the command and all its workers, shared
pages counted once.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import psutil

PRESETS = ("tcrdata", "tcrdata_static", "paper", "release")
SAMPLE_EVERY_S = 0.25
MEGABYTE = 1e6


@dataclass(frozen=True)
class Measured:
    """One preset's build.

    Attributes:
        preset: its name.
        frames: usable frames built.
        labels: that it selected.
        command_s_a_frame: wall time from the shell's point of view, start and selection included.
        peak_mb: of the process tree.
        stages: stage to seconds a frame.
        tables: table to bytes a frame.
        load: the machine's load average before the build.
    """

    preset: str
    frames: int
    labels: int
    command_s_a_frame: float
    peak_mb: float
    stages: dict[str, float]
    tables: dict[str, float]
    load: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--dataset", default="street")
    parser.add_argument("--root", default="frames=50")
    parser.add_argument("--frames", default="all", help="ranges such as 0-49")
    parser.add_argument("--presets", default=",".join(PRESETS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    build = ["build", "--dataset", asked.dataset, "--root", asked.root, "--frames", asked.frames]
    build += ["--workers", str(asked.workers), "--json"]
    found = [best(build, preset, asked.repeat) for preset in asked.presets.split(",")]
    if asked.json:
        print(json.dumps([asdict(measured) for measured in found], indent=2))
    else:
        print(markdown(found))


def best(build: list[str], preset: str, repeat: int) -> Measured:
    """The least of each time over some builds; rows and bytes are the same in all."""
    runs = []
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as folder:
            runs.append(measure(build, preset, Path(folder) / "store"))
    first = runs[0]
    return replace(
        first,
        command_s_a_frame=min(run.command_s_a_frame for run in runs),
        peak_mb=max(run.peak_mb for run in runs),
        stages={stage: min(run.stages[stage] for run in runs) for stage in first.stages},
        load=min(run.load for run in runs),
    )


def measure(build: list[str], preset: str, store: Path) -> Measured:
    """Run one build and ask its report and its store."""
    load = os.getloadavg()[0]
    command = [sys.executable, "-m", "tcrdata", *build, "--store", str(store), "--preset", preset]
    started = time.perf_counter()
    with tempfile.TemporaryFile("w+") as output:
        peak_mb = watched(subprocess.Popen(command, stdout=output))
        seconds = time.perf_counter() - started
        output.seek(0)
        report = json.load(output)
    status = json.loads(tcrdata("status", "--store", str(store), "--json"))
    query = "select count(*) as n from frames where status = 'ok'"
    frames = json.loads(tcrdata("sql", query, "--store", str(store), "--json"))[0]["n"]
    stages: dict[str, float] = {}
    for unit in report["units"]:
        stages[unit["stage"]] = stages.get(unit["stage"], 0.0) + unit["seconds"] / frames
    return Measured(
        preset=preset,
        frames=frames,
        labels=sum(selection["labels"] for selection in report["selections"]),
        command_s_a_frame=seconds / frames,
        peak_mb=peak_mb,
        stages=stages,
        tables={row["table"]: row["bytes"] / frames for row in status["tables"]},
        load=load,
    )


def watched(process: subprocess.Popen[bytes]) -> float:
    """Wait for a process; return the peak of its tree's memory in MB."""
    peak = 0.0
    while process.poll() is None:
        peak = max(peak, tree_mb(process.pid))
        time.sleep(SAMPLE_EVERY_S)
    if process.returncode:
        raise SystemExit(f"the command failed with {process.returncode}")
    return peak


def tree_mb(pid: int) -> float:
    """Memory of a process and all below it; pages that several share count once."""
    total = 0.0
    try:
        root = psutil.Process(pid)
        for process in (root, *root.children(recursive=True)):
            total += process.memory_full_info().pss
    except psutil.Error:
        return 0.0  # one ended while it was asked
    return total / MEGABYTE


def tcrdata(*arguments: str) -> str:
    command = [sys.executable, "-m", "tcrdata", *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def markdown(found: list[Measured]) -> str:
    """Three tables: whole builds, stages, tables."""
    whole = [
        [
            run.preset,
            str(run.frames),
            f"{run.command_s_a_frame:.3f}",
            f"{run.peak_mb:,.0f}",
            str(run.labels),
            f"{run.load:.1f}",
        ]
        for run in found
    ]
    head = ["preset", "frames", "s a frame", "peak MB", "labels", "load before"]
    presets = [run.preset for run in found]
    by_stage = [
        [stage, *(f"{run.stages[stage]:.4f}" if stage in run.stages else "" for run in found)]
        for stage in dict.fromkeys(stage for run in found for stage in run.stages)
    ]
    by_table = [
        [table, *(f"{run.tables[table]:,.0f}" if table in run.tables else "" for run in found)]
        for table in sorted({table for run in found for table in run.tables})
    ]
    total = ["all", *(f"{sum(run.tables.values()):,.0f}" for run in found)]
    return "\n\n".join(
        (
            table(head, whole),
            table(["s a frame", *presets], by_stage),
            table(["bytes a frame", *presets], [*by_table, total]),
        )
    )


def table(head: list[str], rows: list[list[str]]) -> str:
    """A markdown table, numbers to the right."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


if __name__ == "__main__":
    main()
