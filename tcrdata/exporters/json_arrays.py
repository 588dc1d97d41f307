"""JSON arrays that are written element by element: none is ever whole in memory."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import IO, Any

_ENCODER = json.JSONEncoder(allow_nan=False)


class JsonArray:
    """Writes the elements of one array to a text stream, a batch a line."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._started = False
        self.count = 0

    def extend(self, elements: Iterable[Any]) -> None:
        """Append elements; NaN has no place in JSON and raises ValueError."""
        batch = list(elements)
        if batch:
            # One call for the batch: an encoder a row costs more than the rows.
            text = _ENCODER.encode(batch)[1:-1]
            self._stream.write((",\n" if self._started else "[\n") + text)
            self._started = True
            self.count += len(batch)

    def close(self) -> None:
        """End the array; the stream stays open."""
        self._stream.write("\n]" if self._started else "[]")
