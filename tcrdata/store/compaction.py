"""Bundles of small files: what thousands of units wrote, once more in few files for queries.

A bundle takes the place of the files that it holds whenever all of them are asked for; they stay
as they are, so records, snapshots and reads of one sequence know nothing of it. A folder
`compacted/` may be deleted at any time.
"""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from tcrdata.store.bundles import COMPACTED, Bundle, read_bundles
from tcrdata.store.commits import FileEntry, dump_json
from tcrdata.store.filesystem import Filesystem, HashingFile, Staging, storage_errors
from tcrdata.store.parquet import ROWS_A_LIGHT_GROUP, damage_errors, parquet_writer, write_rows
from tcrdata.store.schemas import arrow_schema, is_heavy

ROWS_A_BUNDLE = 2 * ROWS_A_LIGHT_GROUP


def compact(files: Filesystem, entries: Mapping[str, Sequence[FileEntry]]) -> list[Bundle]:
    """Write bundles of the light tables' files; those that are there already are left.

    Files of one stage and round go together, by dataset and sequence, so that a bundle's row
    groups still know their sequences and sources.

    Args:
        files: of the store.
        entries: table to the files of this moment.

    Raises:
        StoreError: a file is damaged, or the disk is full.
    """
    there = {bundle.holds: bundle for bundle in read_bundles(files)}
    found = []
    with files.staging() as staging:
        for table in sorted(entries):
            for members in [] if is_heavy(table) else _groups(entries[table]):
                holds = tuple(entry.path for entry in members)
                found.append(there.get(holds) or _write(files, staging, table, members))
    return found


def _groups(entries: Sequence[FileEntry]) -> Iterator[list[FileEntry]]:
    """Files that become one: two at least, about ROWS_A_BUNDLE rows together."""
    kinds: dict[tuple[str, int], list[FileEntry]] = defaultdict(list)
    for entry in entries:
        kinds[entry.unit.stage, entry.unit.round].append(entry)
    for kind in sorted(kinds):
        group: list[FileEntry] = []
        for entry in sorted(kinds[kind], key=lambda e: (e.unit.dataset, e.unit.sequence, e.path)):
            if group and sum(e.rows for e in group) + entry.rows > ROWS_A_BUNDLE:
                yield from [group] if len(group) > 1 else []
                group = []
            group.append(entry)
        yield from [group] if len(group) > 1 else []


def _write(files: Filesystem, staging: Staging, table: str, members: Sequence[FileEntry]) -> Bundle:
    file = staging.open()
    hashing = HashingFile(file)
    with storage_errors(f"table {table}"):
        writer = parquet_writer(hashing, table)
        for rows in _row_groups(files, table, members):
            write_rows(writer, table, rows)
        writer.close()
        file.flush()
    path = f"{COMPACTED}/{table}/{hashing.sha256[:16]}.parquet"
    rows_in_all = sum(entry.rows for entry in members)
    holds = tuple(entry.path for entry in members)
    bundle = Bundle(table, path, rows_in_all, hashing.size, hashing.sha256, holds)
    _publish(files, staging, file, bundle)
    return bundle


def _row_groups(files: Filesystem, table: str, members: Sequence[FileEntry]) -> Iterator[pa.Table]:
    """The rows of files, a row group at a time."""
    waiting: list[pa.Table] = []
    for entry in members:
        with damage_errors(files.full_path(entry.path)):
            rows = pq.read_table(io.BytesIO(files.read(entry.path)), schema=arrow_schema(table))
        waiting.append(rows)
        while sum(part.num_rows for part in waiting) >= ROWS_A_LIGHT_GROUP:
            gathered = pa.concat_tables(waiting)
            yield gathered.slice(0, ROWS_A_LIGHT_GROUP)
            waiting = [gathered.slice(ROWS_A_LIGHT_GROUP)]
    if sum(part.num_rows for part in waiting):
        yield pa.concat_tables(waiting)


def _publish(files: Filesystem, staging: Staging, file: BinaryIO, bundle: Bundle) -> None:
    """The file first, what says what it holds last: a bundle is there whole or not at all."""
    staging.publish(file, bundle.path)
    content = {
        "table": bundle.table,
        "path": bundle.path,
        "rows": bundle.rows,
        "bytes": bundle.bytes,
        "sha256": bundle.sha256,
        "holds": list(bundle.holds),
    }
    files.create(bundle.path.removesuffix(".parquet") + ".json", dump_json(content, lines=False))
