"""Cuts a sequence into items of work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")


def chunked(items: Sequence[T], size: int) -> Iterator[tuple[T, ...]]:
    """Yield the items in order, `size` at a time; the last chunk may be shorter."""
    for start in range(0, len(items), size):
        yield tuple(items[start : start + size])


def even_spans(count: int, *, largest: int, fewest: int) -> list[tuple[int, int]]:
    """Return spans (first, last + 1) of nearly one length that cover `range(count)`.

    Args:
        count: how many items there are.
        largest: no span is longer.
        fewest: at least so many spans, where there are as many items.
    """
    spans = min(max(-(-count // largest), fewest), count)
    return [(count * i // spans, count * (i + 1) // spans) for i in range(spans)]
