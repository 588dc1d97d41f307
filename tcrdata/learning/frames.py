"""The frames of a training query, read one by one: rows, images, points and evidence."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from tcrdata import registry
from tcrdata.errors import MissingEvidenceError, QueryError
from tcrdata.ingest import frame_of_row
from tcrdata.learning.training_queries import (
    FLOWS,
    SOURCES,
    TrainingQuery,
    load_training_query,
    parameter_values,
    run_training_query,
)
from tcrdata.plan import ROUND
from tcrdata.store import FileEntry, Store, open_store
from tcrdata.store.arrays import decode_flow, decode_points
from tcrdata.types import Dataset, IntArray

TABLES = ("labels", "selections", "sequences", "frames", "images", "sweeps", "point_evidence",
          "flows", "proposals", "confidences", "egomotions", "tracklets")  # fmt: skip
"""What a training query may read; ground truth is not among it."""

NEEDED = ("labels", "sequences", "frames", "images", "sweeps")
"""What a snapshot must cover."""

_ROWS_A_BATCH = 256
_WITH_FRAMES = f"""
select q.* exclude (place), s.root, s.metric_scale, f as frame_row, i.image.path as image_path,
       w.path as points_path
from (select row_number() over () as place, * from ({{select}})) q
join frames f
    on (f.dataset, f.sequence, f.frame, f.round) = (q.dataset, q.sequence, q.frame, {ROUND})
join sequences s on (s.dataset, s.sequence, s.round) = (q.dataset, q.sequence, {ROUND})
left join images i on (i.dataset, i.sequence, i.frame) = (q.dataset, q.sequence, q.frame)
left join sweeps w on (w.dataset, w.sequence, w.frame) = (q.dataset, q.sequence, q.frame)
order by q.place
"""
_ADDED = ("root", "frame_row", "image_path", "points_path")


class Frames:
    """Random access to the frames that a query gives, over a frozen list of files.

    Rows lie in a temporary file that is mapped into memory, dense arrays stay in the store: what
    is held does not grow with the store. Picklable, for the loader's processes.
    """

    def __init__(
        self, url: str, snapshot: str, reads: tuple[str, ...], index: str, parameters: str
    ) -> None:
        """See `open_frames`; `index` is the path of the mapped file."""
        self.url = url
        self.snapshot = snapshot
        self.reads = reads
        self.parameters = parameters
        self._index = index

    def __getstate__(self) -> dict[str, Any]:
        kept = ("url", "snapshot", "reads", "parameters", "_index")
        return {name: self.__dict__[name] for name in kept}

    def __len__(self) -> int:
        return int(self._rows.num_rows)

    def column(self, name: str) -> list[Any]:
        """Return one column of the query for all frames, in the query's order."""
        return list(self._rows[name].to_pylist())

    def drives(self) -> IntArray:
        """Return (N,) which drive each frame is of, numbered in the order of the query."""
        names = pc.binary_join_element_wise(self._rows["dataset"], self._rows["sequence"], "/")
        codes = names.combine_chunks().dictionary_encode().indices
        return np.asarray(codes.to_numpy(zero_copy_only=False), dtype=np.int64)

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return a frame: the query's columns, and what it reads.

        `frame_row` is replaced by `camera`, a `tcrdata.types.Frame`; `image` is (H, W, 3) uint8 or
        None; `points` (N, 3) float32, level frame, metres; `reflectance` (N,); each cue (N,);
        `flow` and `flow_backward` (H, W, 2) float32, pixels.

        Raises:
            FrameError: a file of the dataset is gone or damaged.
            MissingEvidenceError: a cue or a flow was not measured on the frame.
        """
        (row,) = self._rows.slice(number, 1).to_pylist()
        dataset = self._dataset(row["dataset"], row["root"])
        frame = frame_of_row(row["frame_row"], row["image_path"], row["points_path"])
        sample = {name: value for name, value in row.items() if name not in _ADDED}
        sample["camera"] = frame
        if "image" in self.reads:
            sample["image"] = dataset.read_image(frame) if frame.has_image else None
        if "points" in self.reads:
            cloud = dataset.read_points(frame)
            sample["points"], sample["reflectance"] = cloud.xyz, cloud.reflectance
        sample.update(self._evidence(row))
        sample.update(self._flows(row))
        return sample

    def _evidence(self, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return the cues that the query reads, one array each."""
        cues = [name for name in self.reads if name not in SOURCES]
        columns = ["codec", "data", "number_of_points"]
        found = self._encoded(row, "point_evidence", "cue", cues, columns)
        return {
            cue: decode_points(e["codec"], e["data"], e["number_of_points"])
            for cue, e in zip(cues, found, strict=True)
        }

    def _flows(self, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return the flows that the query reads, one field each."""
        names = [name for name in self.reads if name in FLOWS]
        columns = ["codec", "data", "height_px", "width_px"]
        directions = [FLOWS[name] for name in names]
        found = self._encoded(row, "flows", "direction", directions, columns)
        return {
            name: decode_flow(e["codec"], e["data"], e["height_px"], e["width_px"])
            for name, e in zip(names, found, strict=True)
        }

    def _encoded(
        self, row: Mapping[str, Any], table: str, key: str, wanted: list[str], columns: list[str]
    ) -> list[dict[str, Any]]:
        """Return a frame's rows of a heavy table, one for each value of its key that is wanted."""
        if not wanted:
            return []
        entries = self._entries.get((table, row["dataset"], row["sequence"]), [])
        equals = {"frame": row["frame"], **({key: wanted[0]} if len(wanted) == 1 else {})}
        rows = self._store.read_files(table, entries, [key, *columns], {}, equals).to_pylist()
        found = {one[key]: one for one in rows}
        if missing := [name for name in wanted if name not in found]:
            raise MissingEvidenceError(
                f"{row['dataset']}/{row['sequence']} frame {row['frame']}: no {key} "
                f"'{missing[0]}' in {table} of snapshot {self.snapshot}; build with a preset that "
                "measures it, or let the query leave such frames out"
            )
        return [found[name] for name in wanted]

    @cached_property
    def _rows(self) -> pa.Table:
        with pa.memory_map(self._index) as file:
            return pa.ipc.open_file(file).read_all()

    @cached_property
    def _store(self) -> Store:
        return open_store(self.url)

    @cached_property
    def _entries(self) -> dict[tuple[str, str, str], list[FileEntry]]:
        entries: dict[tuple[str, str, str], list[FileEntry]] = {}
        for entry in self._store.snapshot(self.snapshot).files:
            key = (entry.table, entry.unit.dataset, entry.unit.sequence)
            entries.setdefault(key, []).append(entry)
        return entries

    def _dataset(self, name: str, root: str) -> Dataset:
        if (name, root) not in self._datasets:
            self._datasets[name, root] = registry.find("datasets", name).open_dataset(root)
        return self._datasets[name, root]

    @cached_property
    def _datasets(self) -> dict[tuple[str, str], Dataset]:
        return {}


def open_frames(
    store: Store,
    query: str | TrainingQuery,
    *,
    snapshot: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    lacking: str | None = None,
) -> Frames:
    """Run a training query over a snapshot and return its frames.

    Args:
        store: where the rows lie.
        query: see `load_training_query`.
        snapshot: name of a frozen list of files; those of this moment when None.
        parameters: values of the query's variables.
        lacking: what there is none of, where the query gives no frame; None for what it reads.

    Raises:
        SettingsError: an unknown query or parameter.
        QueryError: the SQL does not run.
        MissingEvidenceError: the query gives no frame.
        StoreError: there is no such snapshot, or it does not cover a table that is needed.
    """
    import duckdb

    loaded = load_training_query(query) if isinstance(query, str) else query
    name = snapshot or freeze_training_tables(store)
    frozen = store.snapshot(name).tables
    covered = [table for table in TABLES if table in frozen or table in NEEDED]
    folder = tempfile.TemporaryDirectory(prefix="tcrdata-")
    index = str(Path(folder.name) / "frames.arrow")
    connection = store.connect(snapshot=name, tables=covered)
    try:
        select = run_training_query(connection, loaded, parameters or {})
        values = parameter_values(connection)
        _write_index(connection, select, index)
    except duckdb.Error as error:
        raise QueryError(f"{loaded.name}: {' '.join(str(error).split())}") from error
    finally:
        connection.close()
    described = ", ".join(f"{k} = {v}" for k, v in values.items())
    frames = Frames(store.url, name, loaded.reads, index, described)
    # The file goes with the object, wherever its copies in other processes are.
    weakref.finalize(frames, folder.cleanup)
    if not len(frames):
        read = ", ".join(loaded.reads)
        plain = "positive labels" if "labels" in loaded.text else f"frames with {read}"
        raise MissingEvidenceError(
            f"{loaded.name} gives no frame of {store.url} ({described}): no {lacking or plain}? "
            "see `tcrdata status`"
        )
    return frames


def freeze_training_tables(store: Store) -> str:
    """Freeze what training reads, as it is at this moment; return the snapshot's name."""
    from tcrdata.store.schemas import table_names

    return store.freeze(None, [table for table in TABLES if table in table_names()]).name


def _write_index(connection: Any, select: str, path: str) -> None:
    """Stream the query's rows to a file that can be mapped."""
    reader = connection.sql(_WITH_FRAMES.format(select=select)).to_arrow_reader(_ROWS_A_BATCH)
    with pa.OSFile(path, "wb") as file, pa.ipc.new_file(file, reader.schema) as writer:
        for batch in reader:
            writer.write_batch(batch)
