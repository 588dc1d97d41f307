"""Temporary folders on the local disk, locked as long as their writer lives.

The system drops a lock when its process dies, however it dies: what is not locked is litter.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

_ATTEMPTS = 1000


def locked_folder(top: Path) -> tuple[Path, int]:
    """Make a folder and lock it; again when another writer's sweep came between the two.

    Args:
        top: where to make it.

    Raises:
        OSError: it cannot be made.
    """
    for _ in range(_ATTEMPTS):
        with suppress(FileNotFoundError, FileExistsError):
            top.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(dir=top))
            if (lock := _try_lock(folder)) is not None:
                return folder, lock
    raise OSError(
        errno.EAGAIN, f"no temporary folder can be made in {top}: give the store another place"
    )


def sweep(top: Path) -> None:
    """Remove the folders in `top` that no living writer holds, and `top` itself once empty."""
    # Other writers come and go meanwhile: what is no longer there is swept already.
    with suppress(FileNotFoundError):
        for folder in sorted(top.iterdir()):
            with suppress(FileNotFoundError, NotADirectoryError):
                if (lock := _try_lock(folder)) is not None:
                    shutil.rmtree(folder, ignore_errors=True)
                    os.close(lock)
    with suppress(OSError):
        top.rmdir()


def _try_lock(folder: Path) -> int | None:
    """Lock a folder's lock file; None when a living writer holds it or a sweep removed it."""
    path = folder / "lock"
    lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.stat().st_ino == os.fstat(lock).st_ino:
            return lock
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(lock)
    return None
