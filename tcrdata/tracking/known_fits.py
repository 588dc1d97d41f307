"""Where templates were found to fit, kept on disk for the next pass over the same frames.

A fit follows from a template, a frame and where it is looked for. A template follows from the
frames and boxes that it was made of: its lineage, which names it in few bytes.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

from tcrdata.tracking.templates import Pose
from tcrdata.types import FloatArray

_NAME_BYTES = 16
_ROW = struct.Struct(f"<{_NAME_BYTES}sqqd7d")
_NOWHERE = -1


def lineage(before: bytes, frame: int, box: FloatArray) -> bytes:
    """Return the name of what follows from something named, a frame and a (7,) box in it."""
    content = before + struct.pack("<q", frame) + np.ascontiguousarray(box, np.float64).tobytes()
    return hashlib.blake2b(content, digest_size=_NAME_BYTES).digest()


class KnownFits:
    """Fits by the names of what they follow from: those of a frame are held, all lie in a file.

    The first pass writes the file, later ones read along with their frames.
    """

    def __init__(self, path: Path) -> None:
        """Open the file: to read where there is one, else to write."""
        self._reads = path.exists()
        self._file = path.open("rb" if self._reads else "wb")
        self._held: dict[bytes, Pose | None] = {}
        self._frame = -1
        self._next = self._read() if self._reads else None

    def __enter__(self) -> KnownFits:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def pose(self, name: bytes, frame: int, find: Callable[[], Pose | None]) -> Pose | None:
        """Return a fit as it is known, else as it is found now.

        Args:
            name: of the template and of where it is looked for.
            frame: not less than in the calls before.
            find: says where the template fits.
        """
        if not self._reads:
            pose = find()
            self._write(name, frame, pose)
            return pose
        if frame != self._frame:
            self._go_to(frame)
        return self._held[name] if name in self._held else find()

    def _go_to(self, frame: int) -> None:
        self._held.clear()
        self._frame = frame
        while self._next is not None and self._next[1] <= frame:
            name, at, pose = self._next
            if at == frame:
                self._held[name] = pose
            self._next = self._read()

    def _write(self, name: bytes, frame: int, pose: Pose | None) -> None:
        if pose is None:
            row = _ROW.pack(name, frame, _NOWHERE, 0.0, *np.zeros(7))
        else:
            row = _ROW.pack(name, frame, pose.points, pose.score, *pose.box)
        self._file.write(row)

    def _read(self) -> tuple[bytes, int, Pose | None] | None:
        """Return the next row; None at the end, which a pass that was stopped may have torn."""
        row = self._file.read(_ROW.size)
        if len(row) < _ROW.size:
            return None
        name, frame, points, score, *box = _ROW.unpack(row)
        return name, frame, None if points == _NOWHERE else Pose(np.array(box), score, points)
