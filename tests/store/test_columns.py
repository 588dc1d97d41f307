"""Columns made from buffers are those that Arrow makes of the same values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tcrdata.store.columns import array_of, text_lists

PAIR = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (pa.float64(), [1.5, None, math.nan, np.float64(-0.0), math.inf]),
        (pa.float64(), np.array([1.0, math.nan])),
        (pa.int32(), [3, None, -(2**31)]),
        (pa.int64(), [2**62, 0]),
        (pa.bool_(), [True, None, *[False] * 8, True]),
        (pa.string(), ["", "a", None, "vier Z\u00e4hne"]),
        (pa.string(), ["plain", "text"]),
        (pa.binary(), [b"", b"\x00\xff", None]),
        (pa.list_(pa.int32()), [[1, 2], [], None, [3]]),
        (pa.list_(pa.float64()), [[0.5] * 4, (1.5,)]),
        (PAIR, [{"bytes": None, "path": "a.png"}, {"path": None, "bytes": b"x"}]),
        (pa.map_(pa.string(), pa.string()), [[("a", "1"), ("b", "2")], []]),
        (pa.list_(pa.string()), [None, None]),
        (pa.int32(), []),
    ],
)
def test_equals_what_arrow_makes(kind: pa.DataType, values: Any) -> None:
    made = array_of(kind, values)
    assert made is not None
    made.validate(full=True)
    assert made.type == kind
    assert made.equals(pa.array(values, type=kind, from_pandas=True))


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (pa.int32(), [1.0]),
        (pa.int32(), [True]),
        (pa.bool_(), [1]),
        (pa.float64(), ["1"]),
        (pa.string(), [1]),
        (pa.list_(pa.float64()), [[math.nan]]),
        (PAIR, [{"path": "a.png"}]),
    ],
)
def test_other_values_are_left_to_arrow(kind: pa.DataType, values: Any) -> None:
    assert array_of(kind, values) is None


def test_too_large() -> None:
    with pytest.raises(OverflowError):
        array_of(pa.int32(), [2**31])


@pytest.mark.parametrize("which", [[2, 0, 1, 2], []])
def test_a_few_lists_of_texts_are_repeated(which: list[int]) -> None:
    lists = [["a", "vier Z\u00e4hne"], [], ["", "b"]]
    made = text_lists(lists, np.array(which, np.int64))
    made.validate(full=True)
    assert made.equals(pa.array([lists[number] for number in which], pa.list_(pa.string())))
