"""Seconds and peak memory of each export format over the same synthetic labels.

    python benchmarks/exports.py
    python benchmarks/exports.py --labels 1000000 --formats kitti,coco --folder /tmp/exports

Ten labels a frame and a hundred frames a sequence; one label in ten is undecided. Images and sweeps
are links to one small file, or left out: what is measured is the labels. Each format runs in a
process of its own, on a store that is made first and kept with --folder.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

A_FRAME = 10
FRAMES = 100
SELECTION = "synthetic"
JUDGED = ("proposals", "confidences", "egomotions", "frames", "sequences")
PROJECTION = [93.0, 0, 79.5, 5.8, 0, 93.0, 22.0, 0.03, 0, 0, 1.0, 0.0027]
LEVEL_T_SENSOR = [0, -1.0, 0, 0, 0, 0, -1.0, -0.08, 1.0, 0, 0, -0.27, 0, 0, 0, 1.0]
WIDTH_PX, HEIGHT_PX = 160, 48

_LABELS = """
select $selection as selection_id, 'kitti' as dataset,
       lpad((i // 1000)::varchar, 4, '0') as sequence, (i % 1000 // 10)::integer as frame,
       'kitti/' || sequence || '/' || frame || '/track/' || i % 10 as proposal_id,
       if(i % 10 = 9, 'ignore', 'positive') as state, 0.5 + u1 / 2 as score, 'track' as source,
       sequence || '/' || i % 10 as track_id, 20 * u2 - 10 as x_m, 1.0 as y_m, 5 + 45 * u3 as z_m,
       3.5 + u1 as length_m, 1.5 + u2 as width_m, 1.4 + u3 as height_m, 6.28 * u4 - 3.14 as yaw_rad,
       60 * u1 as left_px, 10 * u2 as top_px, 80 + 70 * u3 as right_px, 20 + 25 * u4 as bottom_px,
       0.2 * u1 as truncated_share, 0.5 * u2 as occluded_share,
       (300 * u3)::integer as number_of_points, 8 * u4 as speed_mps
from (
    select i, random() as u1, random() as u2, random() as u3, random() as u4
    from range($rows) r(i)
)
order by sequence, frame
"""


def make_store(folder: Path, labels: int) -> None:
    """Write a store of labels, frames, images and sweeps; the same on every run."""
    import duckdb
    import numpy as np
    from PIL import Image

    from tcrdata.store import Unit, open_store

    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)).save(folder / "image.png")
    np.zeros((4, 4), np.float32).tofile(folder / "sweep.bin")
    store = open_store(str(folder / "store"), create=True)
    for sequence in range(-(-labels // (A_FRAME * FRAMES))):
        unit = Unit("ingest", "kitti", f"{sequence:04d}", 1)
        with store.writer(unit, settings_hash="benchmark", inputs={}) as writer:
            for table, columns in _sequence(folder).items():
                writer.append(table, columns)
    frozen = store.freeze(None, JUDGED)
    with duckdb.connect() as connection:
        connection.execute("select setseed(0.5)")
        connection.execute("set threads = 1")
        values = {"rows": labels, "selection": SELECTION}
        rows = connection.sql(_LABELS, params=values).to_arrow_table()
    unit = Unit("selection", "_", SELECTION, 1)
    with store.writer(unit, settings_hash="benchmark", inputs={}) as writer:
        writer.append("selections", _selection(frozen.name, labels))
        writer.append("labels", {name: rows[name] for name in rows.column_names})


def _sequence(folder: Path) -> dict[str, dict[str, Any]]:
    """One sequence and its frames; all images and sweeps are one file."""
    numbers = list(range(FRAMES))
    frames = {
        "frame": numbers,
        "timestamp_ns": [number * 10**8 for number in numbers],
        "width_px": [WIDTH_PX] * FRAMES,
        "height_px": [HEIGHT_PX] * FRAMES,
        "projection": [PROJECTION] * FRAMES,
        "camera_T_level": [[1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]] * FRAMES,
        "level_T_sensor": [LEVEL_T_SENSOR] * FRAMES,
        "has_image": [True] * FRAMES,
        "status": ["ok"] * FRAMES,
    }
    sequences = {
        "root": [str(folder)],
        "sensor": ["lidar"],
        "metric_scale": [1.0],
        "static_camera": [False],
        "calibration": ["generated"],
        "fingerprint": ["0"],
        "number_of_frames": [FRAMES],
    }
    image = {"bytes": None, "path": "image.png"}
    steps = FRAMES - 1
    egomotions = {
        "frame": numbers[:-1],
        "frame_to": numbers[1:],
        "method": ["odometry"] * steps,
        "to_T_from": [[1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, -0.5, 0, 0, 0, 1.0]] * steps,
    }
    return {
        "sequences": sequences,
        "frames": frames,
        "egomotions": egomotions,
        "images": {"frame": numbers, "image": [image] * FRAMES},
        "sweeps": {"frame": numbers, "path": ["sweep.bin"] * FRAMES},
    }


def _selection(snapshot: str, labels: int) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "selection_id": SELECTION,
        "name": SELECTION,
        "preset": SELECTION,
        "snapshot": snapshot,
        "rules": [],
        "rule_texts": [],
        "required": [],
        "preset_text": "",
        "parameters": {},
        "proposals_judged": labels,
        "labels": labels,
    }
    return {name: [value] for name, value in plain.items()}


def measure(folder: Path, format_name: str) -> None:
    """Export into an empty folder and print what it took as JSON."""
    from tcrdata import registry
    from tcrdata.exporters.labels import ExportOptions
    from tcrdata.store import open_store

    # A folder of its own for each run: ext4 makes files slowly just after others were removed.
    out = Path(tempfile.mkdtemp(prefix=f"out_{format_name}_", dir=folder))
    start, cpu = time.perf_counter(), time.process_time()
    store = open_store(str(folder / "store"))
    exporter = registry.find("exporters", format_name)
    card = exporter.export(store, SELECTION, out, ExportOptions(labels_only=True))
    seconds = time.perf_counter() - start
    cpu_seconds = time.process_time() - cpu
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    result = {
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "peak_mb": peak_mb,
        "labels": card.labels,
        "files": card.files,
    }
    sys.stdout.write(json.dumps(result) + "\n")


def main() -> None:
    """Measure every format, the best of several runs, and print a table."""
    from tcrdata import console, registry

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--labels", type=int, default=100_000)
    parser.add_argument("--formats", default=",".join(registry.names("exporters")))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.folder, arguments.measure)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = (arguments.folder or Path(temporary)).absolute()
        if not (folder / "store").is_dir():
            make_store(folder, arguments.labels)
        rows = []
        for format_name in arguments.formats.split(","):
            command = (sys.executable, __file__, "--folder", str(folder), "--measure", format_name)
            found = [json.loads(subprocess.check_output(command)) for _ in range(arguments.runs)]
            best = min(found, key=lambda result: float(result["seconds"]))
            rows.append([format_name, *best.values()])
        columns = ("format", "seconds", "CPU seconds", "peak MB", "labels", "files")
        console.print_table(f"{arguments.labels:,} labels", columns, rows)
        for out in folder.glob("out_*"):
            shutil.rmtree(out)


if __name__ == "__main__":
    main()
