"""The one door to a store's files: any fsspec URL, exclusive creation, nothing half visible.

On the local disk a file is written to `<store>/tmp/`, synced, and linked to its name: it is there
whole or not at all, whatever kills the writer. Elsewhere the filesystem's own exclusive creation
does it. No other module opens a path of the store.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

from tcrdata.errors import StoreError
from tcrdata.store.locks import locked_folder, sweep

if TYPE_CHECKING:
    import pyarrow.fs

TEMPORARY = "tmp"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_TOO_LARGE = errno.EFBIG


@contextmanager
def storage_errors(path: str) -> Iterator[None]:
    """Turn an OSError into a StoreError that names the path and what to do."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StoreError(
                f"{path}: the disk is full; free some space and run again, "
                "what was committed is kept"
            ) from error
        if error.errno == _TOO_LARGE:
            raise StoreError(
                f"{path}: the file system or a limit (see ulimit -f) allows no file so large; put "
                "the store elsewhere or raise the limit and run again, what was committed is kept"
            ) from error
        reason = error.strerror or str(error) or type(error).__name__
        raise StoreError(f"{path}: {reason}") from error


class HashingFile(io.RawIOBase):
    """A file being written whose size and sha256 are known at its end."""

    def __init__(self, target: BinaryIO) -> None:
        super().__init__()
        self._target = target
        self._hash = hashlib.sha256()
        self._abandoned = False
        self.size = 0

    def writable(self) -> bool:
        """It only writes."""
        return True

    def abandon(self) -> None:
        """Close the target; whatever a writer still flushes is dropped."""
        self._abandoned = True
        # Closing flushes once more: on a full disk that fails again, and was said already.
        with suppress(OSError):
            self._target.close()

    def write(self, data: Any) -> int:
        """Write all of the data."""
        length = memoryview(data).nbytes
        if self._abandoned:
            return length
        self._hash.update(data)
        self._target.write(data)
        self.size += length
        return length

    @property
    def sha256(self) -> str:
        """Of what was written so far."""
        return self._hash.hexdigest()


class Staging(Protocol):
    """Where files grow that nobody may see yet."""

    def open(self) -> BinaryIO:
        """Start a new file."""
        ...

    def publish(self, file: BinaryIO, path: str) -> bool:
        """Give a finished file its name in the store; False when that is taken."""
        ...


class Filesystem:
    """A store's files by paths relative to it; pickles as its URL.

    Raises:
        StoreError: the URL's protocol is unknown or its package is not installed.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.is_local = True
        if ":" in url:
            self.is_local = "file" in _protocols(self.fs)
            root = self._opened[1]
        else:
            # A folder, as most are: no command over one waits for the import of fsspec.
            root = str(Path(os.path.expanduser(url)).absolute())  # noqa: PTH111
        self.root: str = root.rstrip("/")

    def __reduce__(self) -> tuple[type[Filesystem], tuple[str]]:
        return Filesystem, (self.url,)

    @property
    def fs(self) -> Any:
        """The filesystem itself."""
        return self._opened[0]

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        """The filesystem, and the path of the store in it."""
        import fsspec

        try:
            filesystem, root = fsspec.core.url_to_fs(self.url)
        except (ImportError, ValueError) as error:
            raise StoreError(f"{self.url} is not a place for a store: {error}") from error
        return filesystem, str(root)

    def full_path(self, path: str) -> str:
        """The path as the filesystem itself wants it."""
        return f"{self.root}/{path}"

    def read(self, path: str) -> bytes:
        """The content of a file; StoreError when there is none."""
        target = self.full_path(path)
        with storage_errors(target):
            return Path(target).read_bytes() if self.is_local else bytes(self.fs.cat_file(target))

    def open(self, path: str) -> Any:
        """A file for random reading; OSError when there is none."""
        import pyarrow

        if self.is_local:
            return pyarrow.OSFile(self.full_path(path), "rb")
        return self.fs.open(self.full_path(path), "rb")

    def size(self, path: str) -> int | None:
        """Bytes of a file; None when there is none."""
        try:
            if self.is_local:
                # A Path costs three times as much, and connections ask for thousands of files.
                return os.stat(self.full_path(path)).st_size  # noqa: PTH116
            return int(self.fs.size(self.full_path(path)))
        except (FileNotFoundError, NotADirectoryError):
            return None

    def find(self, folder: str) -> list[str]:
        """Every file below a folder, relative to the store, sorted; none when it is absent."""
        top = self.full_path(folder)
        with storage_errors(top):
            if self.is_local:
                found = [f"{base}/{name}" for base, _, names in os.walk(top) for name in names]
            else:
                self.fs.invalidate_cache(top)
                found = self.fs.find(top)
        start = len(self.root) + 1
        return sorted(path[start:] for path in found)

    def is_empty(self) -> bool:
        """Whether nothing lies at the root but what a killed writer may leave."""
        if self.is_local:
            try:
                return set(os.listdir(self.root)) <= {TEMPORARY}  # noqa: PTH208
            except FileNotFoundError:
                return True
            except NotADirectoryError:
                return False
        if not self.fs.exists(self.root):
            return True
        names = {path.rstrip("/").rpartition("/")[2] for path in self.fs.ls(self.root, False)}
        return names <= {TEMPORARY}

    def create(self, path: str, data: bytes) -> bool:
        """Create a file exclusively, whole or not at all; False when it is already there."""
        with self.staging() as staging:
            file = staging.open()
            with storage_errors(self.full_path(path)):
                file.write(data)
            return staging.publish(file, path)

    @contextmanager
    def staging(self) -> Iterator[Staging]:
        """A place for growing files; gone at the end with all that was not published."""
        if not self.is_local:
            yield _RemoteStaging(self)
            return
        self.sweep()
        with storage_errors(self.root):
            folder, lock = locked_folder(Path(self.full_path(TEMPORARY)))
        try:
            yield _LocalStaging(self, folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)
            with suppress(OSError):
                folder.parent.rmdir()

    def sweep(self) -> None:
        """Remove what killed writers left; living ones hold a lock on theirs."""
        if self.is_local:
            sweep(Path(self.full_path(TEMPORARY)))

    def arrow(self) -> pyarrow.fs.FileSystem:
        """The same filesystem for pyarrow."""
        import pyarrow.fs

        return pyarrow.fs.PyFileSystem(pyarrow.fs.FSSpecHandler(self.fs))


class _LocalStaging:
    """Files in a folder of `<store>/tmp/`, linked into place."""

    def __init__(self, files: Filesystem, folder: Path) -> None:
        self._files = files
        self._folder = folder
        self._count = 0

    def open(self) -> BinaryIO:
        self._count += 1
        path = self._folder / f"{self._count}"
        with storage_errors(str(path)):
            return path.open("xb")

    def publish(self, file: BinaryIO, path: str) -> bool:
        target = Path(self._files.full_path(path))
        with storage_errors(str(target)):
            file.flush()
            os.fsync(file.fileno())
            file.close()
            _make_folders(target.parent)
            try:
                os.link(file.name, target)
            except FileExistsError:
                return False
            _sync_folder(target.parent)
        return True


class _RemoteStaging:
    """Files in memory, sent whole by the filesystem's own exclusive creation."""

    def __init__(self, files: Filesystem) -> None:
        self._files = files

    def open(self) -> BinaryIO:
        return io.BytesIO()

    def publish(self, file: BinaryIO, path: str) -> bool:
        assert isinstance(file, io.BytesIO)
        target = self._files.full_path(path)
        with storage_errors(target):
            try:
                self._files.fs.pipe_file(target, file.getvalue(), mode="create")
            except FileExistsError:
                return False
        return True


def _protocols(filesystem: Any) -> tuple[str, ...]:
    protocol = filesystem.protocol
    return (protocol,) if isinstance(protocol, str) else tuple(protocol)


def _make_folders(folder: Path) -> None:
    """Make a folder and its parents, each synced into its own parent."""
    if folder.is_dir():
        return
    _make_folders(folder.parent)
    folder.mkdir(exist_ok=True)
    _sync_folder(folder.parent)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
