"""JSON arrays that are written element by element: none is ever whole in memory."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any


class JsonArray:
    """Writes the elements of one array to a text stream, an element a line."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._started = False
        self.count = 0

    def extend(self, elements: Iterable[Any]) -> None:
        """Append elements."""
        lines = [json.dumps(element, allow_nan=False) for element in elements]
        if lines:
            self._stream.write((",\n" if self._started else "[\n") + ",\n".join(lines))
            self._started = True
            self.count += len(lines)

    def close(self) -> None:
        """End the array; the stream stays open."""
        self._stream.write("\n]" if self._started else "[]")


def write_json(path: Path, value: Any) -> None:
    """Write a value that is small."""
    path.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")
