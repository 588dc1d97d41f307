"""Columns of plain values as Arrow arrays, made from their buffers.

Arrow's own conversion of Python values imports pandas wherever it is installed, which takes half a
second that no build needs, and looks at each value; these are the kinds that cues give.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tcrdata.types import FloatArray, IntArray

_NOTHING = type(None)


def repeated(value: str | int, count: int) -> pa.Array:
    """A text or an int32 `count` times."""
    if isinstance(value, int):
        numbers = pa.py_buffer(np.full(count, value, dtype=np.int32))
        return pa.Array.from_buffers(pa.int32(), count, [None, numbers])
    data = value.encode()
    offsets = np.arange(count + 1, dtype=np.int32) * len(data)
    return pa.StringArray.from_buffers(count, pa.py_buffer(offsets), pa.py_buffer(data * count))


def text_lists(lists: Sequence[Sequence[str]], which: IntArray) -> pa.Array:
    """Return lists of texts, of which there are few: one of `lists` a number of `which`.

    Raises:
        OverflowError: all values together are too many for one array.
    """
    numbers = which.tolist()
    texts = [[text.encode() for text in its] for its in lists]
    lengths = [np.array([len(text) for text in its], np.int64).tobytes() for its in texts]
    inner = np.frombuffer(b"".join(map(lengths.__getitem__, numbers)), np.int64)
    data = b"".join(map([b"".join(its) for its in texts].__getitem__, numbers))
    counts = np.array([len(its) for its in lists], np.int64)[which]
    values = pa.StringArray.from_buffers(len(inner), pa.py_buffer(_ends(inner)), pa.py_buffer(data))
    return pa.Array.from_buffers(
        pa.list_(pa.string()), len(which), [None, pa.py_buffer(_ends(counts))], children=[values]
    )


def array_of(kind: pa.DataType, values: Any) -> pa.Array | None:
    """Return the column of some values; None where Arrow has to look at them one by one.

    NaN and None become NULL.

    Args:
        kind: Arrow type of the column.
        values: list or array, each value of the very Python type that the column holds, or None.

    Raises:
        OverflowError: a whole number is too large for the column, or all values together are.
    """
    if isinstance(values, np.ndarray):
        plain = pa.types.is_float64(kind) and values.dtype == np.float64 and values.ndim == 1
        return _floats(kind, values) if plain else None
    types = set(map(type, values)) - {_NOTHING}
    if not types:
        return pa.nulls(len(values), type=kind)
    for test, own, make in _MAKERS:
        if test(kind):
            return make(kind, values) if types <= own else None
    return None


def _floats(kind: pa.DataType, values: Sequence[float | None] | FloatArray) -> pa.Array:
    # numpy reads None as NaN, and both stand for NULL.
    numbers = np.array(values, dtype=np.float64)
    return _fixed(kind, numbers, ~np.isnan(numbers))


def _integers(kind: pa.DataType, values: Sequence[int | None]) -> pa.Array:
    filled = [value or 0 for value in values] if None in values else values
    return _fixed(kind, np.array(filled, dtype=np.dtype(str(kind))), _there(values))


def _booleans(kind: pa.DataType, values: Sequence[bool | None]) -> pa.Array:
    bits = np.packbits(np.array(values, dtype=bool), bitorder="little")
    return _fixed(kind, bits, _there(values))


def _texts(kind: pa.DataType, values: Sequence[str | None]) -> pa.Array:
    filled = [value or "" for value in values] if None in values else values
    data = "".join(filled).encode()  # type: ignore[arg-type]
    offsets = _offsets(filled)
    if len(data) != offsets[-1]:
        return _bytes(kind, [None if value is None else value.encode() for value in values])
    return _variable(kind, values, offsets, data)


def _bytes(kind: pa.DataType, values: Sequence[bytes | None]) -> pa.Array:
    filled = [value or b"" for value in values]
    return _variable(kind, values, _offsets(filled), b"".join(filled))


def _lists(kind: pa.DataType, values: Sequence[Any]) -> pa.Array | None:
    filled = [() if value is None else value for value in values]
    inner = array_of(kind.value_type, list(chain.from_iterable(filled)))
    if inner is None or inner.null_count:
        return None
    buffers = [_validity(_there(values)), pa.py_buffer(_offsets(filled))]
    return pa.Array.from_buffers(kind, len(values), buffers, children=[inner])


def _structs(kind: pa.DataType, values: Sequence[Any]) -> pa.Array | None:
    fields = [kind.field(i) for i in range(kind.num_fields)]
    names = {field.name for field in fields}
    if any(value is None or value.keys() != names for value in values):
        return None
    inner = [array_of(field.type, [value[field.name] for value in values]) for field in fields]
    if any(array is None for array in inner):
        return None
    return pa.StructArray.from_arrays(inner, fields=fields)


def _maps(kind: pa.DataType, values: Sequence[Any]) -> pa.Array | None:
    """Maps, each given as a list of pairs."""
    if any(value is None for value in values):
        return None
    pairs = list(chain.from_iterable(values))
    keys = array_of(kind.key_type, [key for key, _ in pairs])
    items = array_of(kind.item_type, [item for _, item in pairs])
    if keys is None or items is None or keys.null_count:
        return None
    offsets = _offsets(values)
    starts = pa.Array.from_buffers(pa.int32(), len(offsets), [None, pa.py_buffer(offsets)])
    return pa.MapArray.from_arrays(starts, keys, items)


_Maker = Callable[[pa.DataType, Any], pa.Array | None]
_MAKERS: tuple[tuple[Callable[[pa.DataType], bool], set[type], _Maker], ...] = (
    (pa.types.is_float64, {float, np.float64}, _floats),
    (pa.types.is_integer, {int}, _integers),
    (pa.types.is_boolean, {bool}, _booleans),
    (pa.types.is_string, {str}, _texts),
    (pa.types.is_binary, {bytes}, _bytes),
    (pa.types.is_map, {list}, _maps),
    (pa.types.is_list, {list, tuple}, _lists),
    (pa.types.is_struct, {dict}, _structs),
)


def _fixed(kind: pa.DataType, data: NDArray[Any], there: NDArray[np.bool_]) -> pa.Array:
    """Values of one width, in a buffer."""
    return pa.Array.from_buffers(kind, len(there), [_validity(there), pa.py_buffer(data)])


def _variable(
    kind: pa.DataType, values: Sequence[Any], offsets: NDArray[np.int32], data: bytes
) -> pa.Array:
    """Values one after the other in a buffer, whose ends stand in another."""
    buffers = [_validity(_there(values)), pa.py_buffer(offsets), pa.py_buffer(data)]
    return pa.Array.from_buffers(kind, len(values), buffers)


def _there(values: Sequence[Any]) -> NDArray[np.bool_]:
    if None not in values:
        return np.ones(len(values), dtype=bool)
    return np.array([value is not None for value in values], dtype=bool)


def _offsets(values: Collection[Any]) -> NDArray[np.int32]:
    """Return where each value begins and the last one ends."""
    return _ends(np.fromiter(map(len, values), np.int64, len(values)))


def _ends(lengths: IntArray) -> NDArray[np.int32]:
    """Return where each of some values begins and the last one ends, of so many bytes or values."""
    offsets = np.zeros(len(lengths) + 1, np.int64)
    np.cumsum(lengths, out=offsets[1:])
    if offsets[-1] > np.iinfo(np.int32).max:
        raise OverflowError(f"{offsets[-1]} bytes or values are too many for one batch")
    return offsets.astype(np.int32)


def _validity(there: NDArray[np.bool_]) -> pa.Buffer | None:
    """Return the bits that say which values are there; None when all are."""
    return None if there.all() else pa.py_buffer(np.packbits(there, bitorder="little"))
