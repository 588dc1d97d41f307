"""Seconds and peak memory of the commands that people ask a store with, on 1,000 sequences.

    python benchmarks/inspection.py --folder /tmp/stores
    python benchmarks/inspection.py --folder /tmp/stores --only funnel,diff

The store has 1,000 synthetic sequences of 100 frames with 20 proposals each, their confidences and
two selections, and `tcrdata compact` has bundled its files once. It is made first and kept with
--folder. Each command is a process of its own, its
start included; the best of --times runs counts.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

FRAMES = 100  # a sequence
STAGES = {"tracks": "track", "static_clusters": "static", "regions_free_space": "free_space"}

_PROPOSALS = """
with numbered as (
    select i, (i // 20)::integer as frame, i % 20 as place,
           if(place < 6, 'track', if(place < 10, 'static', 'free_space')) as source,
           if(source = 'track', 'track', 'l_shape') as fit,
           if(source = 'free_space', i, place) as object
    from range($frames * 20) r(i)
),
drawn as (
    select *,
           hash($sequence, object, 1) / 18446744073709551615 as a,  -- the same over a track
           hash($sequence, object, 2) / 18446744073709551615 as b,
           hash($sequence, object, 3) / 18446744073709551615 as c,
           hash($sequence, i, 4) / 18446744073709551615 as u,  -- anew in each frame
           hash($sequence, i, 5) / 18446744073709551615 as v
    from numbered
)
select 'synthetic/' || $sequence || '/' || lpad(frame::varchar, 6, '0') || '/' || source || '/'
           || lpad(place::varchar, 3, '0') || '/' || fit as proposal_id,
       frame, source, fit, 'r' || i as region_id,
       if(source <> 'free_space', source || place, null) as track_id,
       if(u < 0.9, 'observed', if(v < 0.5, 'gap', 'extended')) as found, 1.0 as metric_scale,
       30 * a - 15 + if(source = 'track', frame * 0.1 * (b - 0.5), 0) as x_m, 1.0 as y_m,
       3 + 37 * c + if(source = 'track', frame * 0.1 * b, 0) as z_m,
       2.5 + 3 * b as length_m, 1.2 + c as width_m, 1.1 + a as height_m, 6 * b - 3 as yaw_rad,
       400 + 300 * a as left_px, 150.0 as top_px, 450 + 300 * a as right_px, 190.0 as bottom_px,
       425 + 300 * a as center_u_px, 170.0 as center_v_px, 0.0 as truncated_share,
       v * v as occluded_share, sqrt(x_m * x_m + z_m * z_m) as range_m,
       (4 + 200 * u * v)::integer as number_of_points, sqrt(u) as core_share, v as edge_share,
       if(source <> 'free_space', (2 + 98 * b)::integer, null) as age_frames,
       if(source = 'track', 9 * c, null) as travel_m, if(source = 'track', sqrt(a), null)
           as straightness,
       false as at_clip_edge,
       if(source = 'static', 0.15 * b, if(source = 'track', sqrt(c), null)) as track_core_share,
       if(source = 'track', sqrt(b), null) as track_box_core_share,
       if(source = 'track', 0.6 * u, null) as overlapped_share, height_m as track_height_m,
       if(source <> 'free_space', (9 * u * u * u)::integer, null) as frames_from_observation,
       if(source = 'track', 10 * b, null) as speed_mps
from drawn
"""
_CONFIDENCES = """
select proposal_id, frame, source, module,
       hash(proposal_id, module) / 18446744073709551615 as confidence,
       confidence as raw_value, 'share' as unit
from proposals
join (values ('track', 'track'), ('track', 'free_space'), ('static', 'shape'),
             ('free_space', 'free_space')) m(source, module) using (source)
where source = $source
order by frame, proposal_id, module
"""
_EGOMOTIONS = """
select i::integer as frame, (i + 1)::integer as frame_to, 'odometry' as method,
       0.55 * hash($sequence, i) / 18446744073709551615 as cycle_error_m,
       if(i + 10 < $frames, 0.15 + 0.6 * hash($sequence, i, 1) / 18446744073709551615, null)
           as alignment_share,
       if(i + 10 < $frames, 10, null) as alignment_frames
from range($frames - 1) r(i)
"""
_FRAMES = """
select i::integer as frame, i * 100000000 as timestamp_ns, 1242 as width_px, 375 as height_px,
       [721.5, 0, 609.6, 0, 0, 721.5, 172.9, 0, 0, 0, 1, 0]::double[] as projection,
       [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]::double[] as camera_T_level,
       [0, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 1]::double[] as level_T_sensor,
       false as has_image, 120000 as number_of_points, 'ok' as status
from range($frames) r(i)
"""
_SEQUENCE = {
    "root": ["/synthetic"],
    "sensor": ["lidar"],
    "metric_scale": [1.0],
    "static_camera": [False],
    "calibration": ["generated"],
    "fingerprint": ["0"],
    "number_of_frames": [FRAMES],
}


def _rows(connection: Any, sql: str, **values: Any) -> dict[str, Any]:
    table = connection.sql(sql, params=values).to_arrow_table()
    return {name: table[name] for name in table.column_names}


def _units(connection: Any, sequence: str) -> dict[str, dict[str, Any]]:
    """Stage to tables to columns of one sequence."""
    keys = {"sequence": sequence, "frames": FRAMES}
    connection.execute("create or replace temp table proposals as " + _PROPOSALS, keys)
    frames = _rows(connection, _FRAMES, frames=FRAMES)
    units = {
        "frames": {"sequences": _SEQUENCE, "frames": frames},
        "odometry": {"egomotions": _rows(connection, _EGOMOTIONS, **keys)},
    }
    for stage, source in STAGES.items():
        chosen = _rows(connection, "from proposals where source = $source", source=source)
        units[stage] = {
            "proposals": chosen,
            "confidences": _rows(connection, _CONFIDENCES, source=source),
        }
    return units


def make_store(folder: Path, sequences: int) -> None:
    """Write a store of drawn evidence, the same in every run."""
    import duckdb

    from tcrdata.store import Unit, open_store

    store = open_store(str(folder), create=True)
    with duckdb.connect() as connection:
        connection.execute("set threads = 1")
        for number in range(sequences):
            sequence = f"{number:05d}"
            for stage, tables in _units(connection, sequence).items():
                unit = Unit(stage, "synthetic", sequence, 1)
                with store.writer(unit, settings_hash="benchmark", inputs={}) as writer:
                    for table, columns in tables.items():
                        writer.append(table, columns)
    store.checkpoint()


def add_selections(folder: Path) -> None:
    """Select labels twice and bundle the files; nothing is done where that was done."""
    from tcrdata.rules import select
    from tcrdata.store import open_store

    store = open_store(str(folder))
    select(store, "tcrdata")
    select(store, "tcrdata", {"min_travel_m": 5, "min_points": 20}, name="strict")
    store.compact()


def commands(folder: Path, out: Path) -> dict[str, list[str]]:
    """Each command that is measured, by what people call it."""
    from tcrdata.store import open_store

    store = open_store(str(folder))
    (label,) = (
        store.connect(tables=["labels"])
        .sql(
            "select proposal_id from labels order by selection_id, proposal_id limit 1 offset 1000"
        )
        .fetchall()
    )
    return {
        "funnel": ["funnel", "--selection", "tcrdata"],
        "diff": ["diff", "tcrdata", "strict"],
        "why": ["why", label[0], "--selection", "tcrdata"],
        "check": ["check", "--set", "min_points=12", "--name", "again"],
        "report": ["report", "--selection", "tcrdata", "--out", str(out / "report.html")],
    }


def measure(command: list[str], store: Path) -> tuple[float, float, int]:
    """Wall and CPU seconds and peak megabytes of a command in a process of its own."""
    words = [sys.executable, "-m", "tcrdata", *command, "--store", str(store)]
    started = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, used = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: {said}")
    return seconds, used.ru_utime + used.ru_stime, used.ru_maxrss // 1024


def measure_writing(command: list[str], store: Path) -> tuple[float, float, int]:
    """As `measure`, on a copy: run again it would find its labels there.

    The copy is made of hard links, since what is there is never changed.
    """
    with tempfile.TemporaryDirectory(dir=store.parent) as temporary:
        own = Path(temporary) / "store"
        shutil.copytree(store, own, copy_function=os.link)
        return measure(command, own)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sequences", type=int, default=1000)
    parser.add_argument("--folder", type=Path, help="keep the store here and reuse it")
    parser.add_argument("--only", help="commands, with commas between; all when left out")
    parser.add_argument("--times", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (asked.folder or Path(temporary)) / f"inspection_{asked.sequences}"
        if not folder.exists():
            make_store(folder, asked.sequences)
        add_selections(folder)
        print("after `tcrdata compact`, the best of", asked.times, "runs each:\n")
        print("| command | s | CPU s | peak MB | load before |")
        print("| --- | ---: | ---: | ---: | ---: |")
        for name, command in commands(folder, Path(temporary)).items():
            if asked.only is None or name in asked.only.split(","):
                load = os.getloadavg()[0]
                run = measure_writing if name == "check" else measure
                seconds, cpu, peak = min(run(command, folder) for _ in range(asked.times))
                print(f"| {name} | {seconds:.2f} | {cpu:.2f} | {peak:,} | {load:.1f} |", flush=True)


if __name__ == "__main__":
    main()
