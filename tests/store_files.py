"""Compares stores by their bytes."""

from __future__ import annotations

import hashlib
from pathlib import Path


def digests(store: Path, *parts: str) -> dict[str, str]:
    """sha256 of every file of a store, by its path; only below some of its folders if named."""
    return {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(store.rglob("*"))
        if path.is_file() and (not parts or path.relative_to(store).parts[0] in parts)
    }
