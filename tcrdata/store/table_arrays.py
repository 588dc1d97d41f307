"""Columns of Arrow tables as arrays.

Arrow's own `to_numpy` imports pandas wherever it is installed: half a second that neither builds
nor exports need.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tcrdata.types import BoolArray, FloatArray, IntArray

_Number = TypeVar("_Number", np.float64, np.int64, np.uint8)


def numbers(column: pa.ChunkedArray) -> FloatArray:
    """Return (N,) float64 of a numeric column; NaN for NULL."""
    values = _values(_whole(column.cast(pa.float64())), np.float64)
    return np.where(truths(column.is_valid()), values, np.nan)


def whole_numbers(column: pa.ChunkedArray) -> IntArray:
    """Return (N,) int64 of a column of whole numbers without NULL."""
    return _values(_whole(column.cast(pa.int64())), np.int64)


def truths(column: pa.ChunkedArray) -> BoolArray:
    """Return (N,) of a boolean column without NULL."""
    return _values(_whole(column.cast(pa.uint8())), np.uint8).astype(np.bool_)


def columns(table: pa.Table, names: tuple[str, ...]) -> FloatArray:
    """Return (N, len(names)) float64 of numeric columns; NaN for NULL."""
    return np.column_stack([numbers(table[name]) for name in names])


def matrices(table: pa.Table, name: str, shape: tuple[int, int]) -> FloatArray:
    """Return (N, *shape) of a column of row-major lists; NaN where it is NULL."""
    column = table[name]
    result = np.full((len(column), *shape), np.nan)
    flat = _values(_whole(column).flatten(), np.float64)
    result[truths(column.is_valid())] = flat.reshape(-1, *shape)
    return result


def index_lists(column: pa.ChunkedArray) -> tuple[IntArray, ...]:
    """Return the lists of whole numbers of a column, an array each; an empty one for NULL."""
    whole = _whole(column)
    flat = whole_numbers(pa.chunked_array([whole.flatten()]))
    lengths = numbers(pa.chunked_array([pc.list_value_length(whole)]))
    ends = np.cumsum(np.nan_to_num(lengths)).astype(np.int64)
    return tuple(np.split(flat, ends[:-1])) if len(whole) else ()


def rows_at(table: pa.Table, rows: IntArray) -> pa.Table:
    """Return some rows of a table, given as (K,) int64."""
    buffer = pa.py_buffer(np.ascontiguousarray(rows, dtype=np.int64))
    return table.take(pa.Array.from_buffers(pa.int64(), len(rows), [None, buffer]))


def by_sequence(table: pa.Table) -> dict[str, pa.Table]:
    """Return the rows of each sequence, of rows in that order."""
    runs = pc.run_end_encode(_whole(table["sequence"]))
    edges = pairwise([0, *runs.run_ends.to_pylist()])
    return {
        name: table.slice(start, end - start)
        for name, (start, end) in zip(runs.values.to_pylist(), edges, strict=True)
    }


def _whole(column: pa.ChunkedArray) -> pa.Array:
    """Return a column as one array."""
    if column.num_chunks == 1:
        return column.chunk(0)
    return pa.concat_arrays([pa.nulls(0, column.type), *column.chunks])


def _values(array: pa.Array, kind: type[_Number]) -> NDArray[_Number]:
    """Return the numbers of an array of that kind: anything where it has NULL."""
    buffer = array.buffers()[1]
    if buffer is None:
        return np.empty(0, kind)
    return np.frombuffer(buffer, kind)[array.offset : array.offset + len(array)]
