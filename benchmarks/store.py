"""Bytes and read times of the store: the flow codec, single rows, stores of 1,000 sequences.

Run: python benchmarks/store.py [--sequences 1000]
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tcrdata.store import Store, Unit, open_store
from tcrdata.store.arrays import decode_flow, encode_flow
from tcrdata.types import Float32Array

HEIGHT_PX, WIDTH_PX = 375, 1242
FLOW_ROWS = 64
STAGES = ("frames", "odometry", "ground", "regions", "tracks")


def main() -> None:
    """Print each measurement as one line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=1000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        flow_codec()
        single_rows(folder)
        many_units(folder, arguments.sequences)


def flow_codec() -> None:
    """Bytes and times of the flow codec, beside those of compressed and raw floats."""
    flow = synthetic_flow()
    codec, data = encode_flow(flow)
    compressed = io.BytesIO()
    np.savez_compressed(compressed, flow=flow)
    say("flow, raw float32", f"{flow.nbytes / 1e3:,.0f} KB")
    say("flow, npz", f"{len(compressed.getvalue()) / 1e3:,.0f} KB", best(lambda: load(compressed)))
    say(f"flow, store's codec ({codec})", f"{len(data) / 1e3:,.0f} KB")
    say("  encode", "", best(lambda: encode_flow(flow)))
    say("  decode", "", best(lambda: decode_flow(codec, data, HEIGHT_PX, WIDTH_PX)))
    error_px = np.abs(decode_flow(codec, data, HEIGHT_PX, WIDTH_PX) - flow).max()
    say("  largest error", f"{error_px:.4f} px")


def single_rows(folder: str) -> None:
    """One flow out of many, at random, decoded and not, beside a folder of raw files."""
    store = open_store(f"{folder}/flows", create=True)
    codec, data = encode_flow(synthetic_flow())
    with store.writer(Unit("flow", "demo", "0", 1), settings_hash="s", inputs={}) as writer:
        for frame in range(FLOW_ROWS):
            writer.append("flows", flow_row(frame, codec, data))
            Path(f"{folder}/{frame}.bin").write_bytes(data)
    order = iter(np.random.default_rng(0).integers(0, FLOW_ROWS, 10_000).tolist())
    tables = store.tables("demo", "0", 1)
    read = best(lambda: tables.read("flows", ["data"], frame=next(order)), times=40)
    say("a random row of flows", "", read)
    say("  as a plain file", "", best(lambda: Path(f"{folder}/{next(order)}.bin").read_bytes()))
    connection = store.connect(tables=["flows"])
    query = "select data from flows where frame = ?"
    say("  by SQL", "", best(lambda: connection.execute(query, [next(order)]).fetchall(), times=10))


def many_units(folder: str, sequences: int) -> None:
    """What it takes to commit, list and connect to a store of many sequences."""
    url = f"{folder}/many"
    store = open_store(url, create=True)
    start = time.perf_counter()
    for sequence in range(sequences):
        for stage in STAGES:
            commit(store, Unit(stage, "demo", f"{sequence:04d}", 1))
    units = sequences * len(STAGES)
    say(f"commit, of {units:,}", "", (time.perf_counter() - start) / units)
    say("open and read all records", "", best(lambda: open_store(url).records(), times=3))
    store.checkpoint(least=1)
    say("  with a checkpoint", "", best(lambda: open_store(url).records(), times=3))
    say("  again, in the same process", "", best(store.records, times=3))
    say("connect, all tables", "", best(store.connect, times=3))
    say("  one table", "", best(lambda: store.connect(tables=["egomotions"]), times=3))
    say("freeze", "", best(store.freeze, times=3))
    connection = store.connect()
    count = "select count(*) from egomotions where sequence = '0007'"
    say("a selective query", "", best(lambda: connection.execute(count).fetchall(), times=3))


def commit(store: Store, unit: Unit) -> None:
    """One unit with one small table, and a heavy one for the ground."""
    frames = list(range(4))
    with store.writer(unit, settings_hash="s", inputs={}) as writer:
        if unit.stage == "ground":
            data = [b"0" * 1000] * len(frames)
            rows = {"frame": frames, "cue": ["ground"] * 4, "number_of_points": frames}
            writer.append("point_evidence", {**rows, "codec": ["u8"] * 4, "data": data})
        else:
            rows = {"frame": frames, "frame_to": frames, "method": [unit.stage] * 4}
            writer.append("egomotions", rows)


def synthetic_flow() -> Float32Array:
    """(375, 1242, 2) float32, px: a drive forward with the noise of a real estimator."""
    y, x = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX].astype(np.float32)
    scale = np.maximum(y - 170, 4) / 400
    noise = np.random.default_rng(0).normal(0, 0.03, (HEIGHT_PX, WIDTH_PX, 2))
    flow = np.stack([(x - 610) * scale * 0.1, (y - 170) * scale * 0.1], axis=2)
    return np.asarray(flow + noise, dtype=np.float32)


def flow_row(frame: int, codec: str, data: bytes) -> dict[str, list[Any]]:
    """One row of `flows`."""
    return {
        "frame": [frame],
        "frame_to": [frame + 1],
        "direction": ["forward"],
        "method": ["dis"],
        "width_px": [WIDTH_PX],
        "height_px": [HEIGHT_PX],
        "codec": [codec],
        "data": [data],
    }


def load(compressed: io.BytesIO) -> Float32Array:
    """Read an array out of an npz file in memory."""
    compressed.seek(0)
    return np.asarray(np.load(compressed)["flow"])


def best(function: Callable[[], object], times: int = 5) -> float:
    """Shortest of several runs, in seconds."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def say(what: str, value: str, seconds: float | None = None) -> None:
    """Print one measurement."""
    took = "" if seconds is None else f"{seconds * 1e3:10.2f} ms"
    print(f"{what:32s} {value:>12s} {took}")


if __name__ == "__main__":
    main()
