"""Seconds and peak memory of `check` over synthetic proposals with four modules each.

    python benchmarks/check.py --proposals 1000000
    python benchmarks/check.py --proposals 10000000 --folder /tmp/stores

The presets are the ones that ship, and one that sums the confidences of four modules of every
proposal. Each runs in a process of its own, on a store that is made first and kept with --folder.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

A_SEQUENCE = 50_000  # proposals
A_FRAME = 20
PRESETS = ("paper", "release", "tcrdata", "tcrdata_static", "modules")
STAGES = {
    "tracks": "track",
    "static_clusters": "static",
    "regions_paper": "paper",
    "regions_release": "release",
    "regions_free_space": "free_space",
}

_PROPOSALS = """
select 'synthetic/' || $sequence || '/' || lpad((i // 20)::varchar, 6, '0') || '/' || source
           || '/' || lpad((i % 20)::varchar, 3, '0') || '/' || fit as proposal_id,
       (i // 20)::integer as frame, source, fit, 'region' as region_id, 'track' as track_id,
       'observed' as found, 1.0 as metric_scale, x_m, 1.0 as y_m, z_m, 3.0 + u1 as length_m,
       1.5 + u2 as width_m, 1.2 + u3 as height_m, u4 as yaw_rad, 0.0 as left_px, 0.0 as top_px,
       100.0 as right_px, 50.0 as bottom_px, sqrt(x_m * x_m + z_m * z_m) as range_m,
       (200 * u1 * u2)::integer as number_of_points, u3 as core_share, 0.4 as motion_threshold_m,
       u1 as motion_3d_m, u2 as center_surround_chi2, (300 * u1)::integer as voxels_a,
       (300 * u3)::integer as voxels_b, (9 * u2)::integer as smallest_side_voxels,
       (40 * u1)::integer as projected_px, (1 + 19 * u2)::integer as size_rank, u1 as edge_share,
       (20 * u4)::integer as age_frames, 8 * u2 as travel_m, u4 as straightness,
       false as at_clip_edge,
       case source when 'static' then 0.15 * u2 else sqrt(u1) end as track_core_share,
       0.6 * u4 as overlapped_share, 1.2 + u3 as track_height_m,
       (9 * u3 * u3)::integer as frames_from_observation
from (
    select i, ['track', 'static', 'paper', 'release', 'free_space'][1 + i % 20 // 4] as source,
           ['track', 'l_shape', 'min_area', 'min_area', 'l_shape'][1 + i % 20 // 4] as fit,
           random() as u1, random() as u2, random() as u3, random() as u4,
           40 * random() - 20 as x_m, 40 * random() as z_m
    from range($rows) r(i)
)
"""
_CONFIDENCES = """
select proposal_id, frame, source, module, random() as confidence, random() as raw_value,
       'share' as unit
from proposals, (select unnest(['motion_3d', 'motion_2d', 'track', 'shape']) as module)
where source = $source
"""
_EGOMOTIONS = """
select i::integer as frame, (i + 1)::integer as frame_to, method, 0.3 * random() as cycle_error_m,
       0.4 + 0.6 * random() as alignment_share, 10 as alignment_frames
from range($frames) r(i), (values ('odometry'), ('flow_ransac')) m(method)
"""


def _rows(connection: Any, sql: str, values: dict[str, Any]) -> dict[str, Any]:
    table = connection.sql(sql, params=values).to_arrow_table()
    return {name: table[name] for name in table.column_names}


def _write(store: Any, stage: str, sequence: str, tables: dict[str, Any]) -> None:
    from tcrdata.store import Unit

    unit = Unit(stage, "synthetic", sequence, 1)
    with store.writer(unit, settings_hash="benchmark", inputs={}) as writer:
        for table, columns in tables.items():
            writer.append(table, columns)


def make_store(folder: Path, proposals: int) -> None:
    """Write a store of whole sequences of random evidence; seeded."""
    import duckdb

    from tcrdata.store import open_store

    store = open_store(str(folder), create=True)
    with duckdb.connect() as connection:
        connection.execute("set threads = 1")
        for number in range(proposals // A_SEQUENCE):
            sequence = f"{number:05d}"
            connection.execute(f"select setseed({number / 1e6})")
            rows = {"sequence": sequence, "rows": A_SEQUENCE}
            connection.execute("create or replace temp table proposals as " + _PROPOSALS, rows)
            frames = {"frames": A_SEQUENCE // A_FRAME}
            for stage, source in STAGES.items():
                where = {"source": source}
                of_stage = {
                    "proposals": _rows(connection, "from proposals where source = $source", where),
                    "confidences": _rows(connection, _CONFIDENCES, where),
                }
                _write(store, stage, sequence, of_stage)
            _write(
                store, "odometry", sequence, {"egomotions": _rows(connection, _EGOMOTIONS, frames)}
            )
            _write(store, "flow_ransac", sequence, {})
    store.checkpoint()


def check(folder: Path, preset: str) -> dict[str, float | str]:
    """Run one selection and measure this process."""
    from tcrdata.rules import select
    from tcrdata.store import open_store

    if preset == "modules":
        preset = str(Path(__file__).parent / "modules" / "modules.sql")
    store = open_store(str(folder))
    wall, cpu = time.perf_counter(), time.process_time()
    made = select(store, preset)
    return {
        "preset": made.preset,
        "proposals": made.proposals_judged,
        "labels": made.labels,
        "wall_s": round(time.perf_counter() - wall, 2),
        "cpu_s": round(time.process_time() - cpu, 2),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--proposals", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path, help="keep the store here and reuse its evidence")
    parser.add_argument("--preset", choices=PRESETS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.preset:
        print(json.dumps(check(asked.folder, asked.preset)))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = (asked.folder or Path(temporary)) / f"check_{asked.proposals}"
        if not folder.exists():
            make_store(folder, asked.proposals)
        for preset in PRESETS:
            command = [sys.executable, __file__, "--folder", str(folder), "--preset", preset]
            subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
