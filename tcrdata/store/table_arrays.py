"""Columns of Arrow tables as arrays.

Arrow's own `to_numpy` imports pandas wherever it is installed: half a second that neither builds
nor exports need.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tcrdata.types import BoolArray, FloatArray, IntArray

_Number = TypeVar("_Number", np.float64, np.int64, np.uint8)


def numbers(column: pa.ChunkedArray) -> FloatArray:
    """Return (N,) float64 of a numeric column; NaN for NULL."""
    whole = _whole(column)
    return np.where(_validity(whole), _values(whole, np.float64), np.nan)


def whole_numbers(column: pa.ChunkedArray) -> IntArray:
    """Return (N,) int64 of a column of whole numbers without NULL."""
    return _values(_whole(column), np.int64)


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


def index_lists(column: pa.ChunkedArray) -> list[IntArray]:
    """Return the lists of whole numbers of a column, an array each; an empty one for NULL."""
    found: list[IntArray] = []
    for chunk in column.chunks:
        inner = whole_numbers(pa.chunked_array([chunk.values]))
        buffer = chunk.buffers()[1]
        ends = np.frombuffer(buffer, np.int32)[chunk.offset :] if buffer else np.zeros(1, np.int32)
        spans = zip(ends[: len(chunk)].tolist(), ends[1 : len(chunk) + 1].tolist(), strict=True)
        found += [inner[a:b] for a, b in spans]
    return found


def rows_at(table: pa.Table, rows: IntArray) -> pa.Table:
    """Return some rows of a table, given as (K,) int64."""
    buffer = pa.py_buffer(np.ascontiguousarray(rows, dtype=np.int64))
    return table.take(pa.Array.from_buffers(pa.int64(), len(rows), [None, buffer]))


def by_sequence(table: pa.Table) -> dict[str, pa.Table]:
    """Return the rows of each sequence, of rows in that order."""
    import pyarrow.compute as pc

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


def _validity(array: pa.Array) -> BoolArray:
    """Return which values are there."""
    buffer = array.buffers()[0]
    if buffer is None:
        return np.ones(len(array), np.bool_)
    bits = np.unpackbits(np.frombuffer(buffer, np.uint8), bitorder="little")
    return bits[array.offset : array.offset + len(array)].view(np.bool_)


def _values(array: pa.Array, kind: type[_Number]) -> NDArray[_Number]:
    """Return the values of an array as numbers of a kind: anything where it has NULL."""
    own = array.type
    if not (pa.types.is_integer(own) or pa.types.is_floating(own)):
        # Arrow's functions, whose import takes longer than most tables.
        array, own = array.cast(pa.from_numpy_dtype(kind)), pa.from_numpy_dtype(kind)
    buffer = array.buffers()[1]
    if buffer is None:
        return np.empty(0, kind)
    values = np.frombuffer(buffer, own.to_pandas_dtype())[array.offset : array.offset + len(array)]
    return values.astype(kind, copy=False)
