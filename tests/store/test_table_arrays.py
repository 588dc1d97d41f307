"""Columns as arrays: NULLs, no rows, several chunks; and without pandas."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa

from tcrdata.store.table_arrays import (
    by_sequence,
    columns,
    index_lists,
    matrices,
    numbers,
    rows_at,
    truths,
    whole_numbers,
)

CHUNKS = pa.chunked_array([pa.array([1, None], pa.int32()), pa.array([3], pa.int32())])
NONE = CHUNKS.slice(0, 0)

WITHOUT_PANDAS = """
import sys

import duckdb

from store_rows import commit, confidences
from tcrdata.store import open_store
from tcrdata.store.table_arrays import by_sequence, columns, matrices, rows_at, truths

table = duckdb.sql(
    "select i, i > 1 as more, if(i = 2, null, [1::double, i]) as pair, "
    "'ab'[1 + i // 2] as sequence from range(4) r(i)"
).to_arrow_table()
assert truths(table["more"]).tolist() == [False, False, True, True]
assert matrices(table, "pair", (1, 2))[3].tolist() == [[1, 3]]
parts = by_sequence(rows_at(table, columns(table, ("i",))[:, 0].astype(int)))
assert [part.num_rows for part in parts.values()] == [2, 2]
assert by_sequence(table.slice(0, 0)) == {}
commit(open_store("memory://plain", create=True), confidences=confidences(3))
assert "pandas" not in sys.modules
"""


def test_null_is_nan() -> None:
    np.testing.assert_array_equal(numbers(CHUNKS), [1, np.nan, 3])
    np.testing.assert_array_equal(numbers(CHUNKS.slice(1)), [np.nan, 3])
    np.testing.assert_array_equal(numbers(CHUNKS.slice(2)), [3])
    table = pa.table({"a": CHUNKS, "b": pa.array([None, 2.5, 4.5])})
    np.testing.assert_array_equal(columns(table.slice(1), ("a", "b")), [[np.nan, 2.5], [3.0, 4.5]])


def test_no_rows() -> None:
    assert numbers(NONE).shape == whole_numbers(NONE).shape == (0,)
    assert truths(NONE.is_valid()).tolist() == []
    empty = pa.chunked_array([], pa.list_(pa.float64()))
    assert matrices(pa.table({"m": empty}), "m", (4, 4)).shape == (0, 4, 4)
    assert by_sequence(pa.table({"sequence": pa.chunked_array([], pa.string())})) == {}


def test_matrices_of_a_part_of_a_table() -> None:
    table = pa.table({"m": pa.array([[1.0, 2.0], None, [3.0, 4.0], [5.0, 6.0]])})
    found = matrices(table.slice(1, 2), "m", (2, 1))
    np.testing.assert_array_equal(found, [[[np.nan], [np.nan]], [[3], [4]]])


def test_lists_of_a_part_of_a_column() -> None:
    part = pa.array([[9], [1, 2], None, [3]], pa.list_(pa.int32())).slice(1)
    column = pa.chunked_array([part, part.slice(0, 1)])
    assert [row.tolist() for row in index_lists(column)] == [[1, 2], [], [3], [1, 2]]
    assert index_lists(pa.chunked_array([], pa.list_(pa.int32()))) == []


def test_rows_of_sequences() -> None:
    table = pa.table({"sequence": ["a", "b", "b", "c"], "n": [0, 1, 2, 3]})
    assert {k: v["n"].to_pylist() for k, v in by_sequence(table).items()} == {
        "a": [0],
        "b": [1, 2],
        "c": [3],
    }
    assert rows_at(table, np.array([3, 1]))["n"].to_pylist() == [3, 1]


def test_pandas_is_not_imported() -> None:
    subprocess.run([sys.executable, "-c", WITHOUT_PANDAS], check=True, cwd=Path(__file__).parent)
