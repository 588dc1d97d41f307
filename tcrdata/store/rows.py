"""Columns as the cues give them to Arrow rows that fit a table's schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from tcrdata.errors import SchemaError
from tcrdata.store.columns import array_of, repeated
from tcrdata.store.commits import ANY_DATASET, Unit
from tcrdata.store.schemas import arrow_schema, is_view

_KEYS = ("dataset", "sequence", "round")


def to_rows(table: str, columns: Mapping[str, Any], unit: Unit) -> pa.Table:
    """Build the rows of a batch.

    Columns that are missing become NULL; `dataset`, `sequence` and `round` come from the unit.
    NaN becomes NULL: in SQL it would count as larger than every bound.

    Raises:
        SchemaError: an unknown table or column, lengths that differ, a value of another type, a
            NULL where the schema has none, or a key that is not the unit's; names table and column.
    """
    schema = arrow_schema(table)
    if is_view(table):
        raise SchemaError(f"table {table} is a view: it is worked out, never written")
    if unknown := [name for name in columns if name not in schema.names]:
        raise SchemaError(
            f"table {table} has no column {unknown[0]}: its columns are {', '.join(schema.names)}"
        )
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise SchemaError(f"table {table}: columns differ in length: {listed}")
    count = next(iter(lengths.values()), 0)
    arrays = [_column(table, field, columns, count, unit) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _column(
    table: str, field: pa.Field, columns: Mapping[str, Any], count: int, unit: Unit
) -> pa.Array | pa.ChunkedArray:
    """One column of a batch: given, filled in, or NULL."""
    own = getattr(unit, field.name) if field.name in _KEYS else None
    if field.name in columns:
        array = _to_array(table, field, columns[field.name])
        if own is not None and unit.dataset != ANY_DATASET:
            _check_key(table, field.name, array, own)
    elif own is not None:
        array = repeated(own, count)
    else:
        array = pa.nulls(count, type=field.type)
    if not field.nullable and array.null_count:
        row = array.is_null().to_pylist().index(True)
        what = "missing" if field.name not in columns else f"NULL or NaN in row {row}"
        raise SchemaError(f"table {table}, column {field.name}: {what}, but it is not null")
    return array


def _check_key(table: str, name: str, array: pa.Array, own: Any) -> None:
    others = [value for value in array.unique().to_pylist() if value != own]
    if others:
        raise SchemaError(
            f"table {table}, column {name}: {others[0]!r} is not the unit's {own!r}; leave it out"
        )


def _to_array(table: str, field: pa.Field, values: Any) -> pa.Array | pa.ChunkedArray:
    """Convert without losing anything but the difference of NaN and NULL."""
    try:
        if isinstance(values, pa.Array | pa.ChunkedArray):
            return values if values.type == field.type else values.cast(field.type)
        if isinstance(values, np.ndarray) and values.ndim > 1:
            values = list(values.reshape(len(values), -1)) if len(values) else []
        if pa.types.is_map(field.type):
            values = [v if v is None else sorted(dict(v).items()) for v in values]
        array = array_of(field.type, values)
        if array is not None:
            return array
        _check_kind(field.type, values)
        return pa.array(values, type=field.type, from_pandas=True)
    except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise SchemaError(
            f"table {table}, column {field.name}: not {field.type} ({reason})"
        ) from error


def _check_kind(kind: pa.DataType, values: Any) -> None:
    """Refuse what pyarrow would change silently: fractions to integers, numbers to booleans."""
    if isinstance(values, np.ndarray):
        if pa.types.is_boolean(kind) and values.dtype.kind not in "bO":
            raise TypeError(f"got {values.dtype}")
        return
    if pa.types.is_integer(kind):
        for value in values:
            if isinstance(value, float | np.floating) and value == value and value % 1:
                raise ValueError(f"{value} is not whole")
