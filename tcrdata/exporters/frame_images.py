"""The images of frames as encoded files: the dataset's own, or made where there is none."""

from __future__ import annotations

import io
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tcrdata import registry
from tcrdata.errors import FrameError
from tcrdata.exporters.labels import ExportOptions, SequenceLabels
from tcrdata.types import Dataset, Frame

_MADE = ".png"


@dataclass(frozen=True)
class EncodedImage:
    """An image as its file holds it.

    Attributes:
        data: the file's bytes.
        suffix: of the file's name, lower case, with its dot.
    """

    data: bytes
    suffix: str


class FrameImages:
    """The images of one sequence, read one at a time; rows are those of `SequenceLabels.frames`."""

    def __init__(self, part: SequenceLabels) -> None:
        self._part = part
        self._numbers: list[int] = part.frames["frame"].to_pylist()
        self._has_image: list[bool] = part.frames["has_image"].to_pylist()
        self._paths: list[str | None] = part.frames["image_path"].to_pylist()

    def has_image(self, row: int) -> bool:
        """Whether the build found an image of this frame that can be used."""
        return self._has_image[row]

    def name(self, row: int) -> str:
        """Return `<sequence>/<frame><suffix>`: where an export keeps the image of a frame."""
        return f"{self._part.sequence}/{self._numbers[row]:06d}{self._suffix(row)}"

    def encoded(self, row: int) -> EncodedImage:
        """Return the bytes of the dataset's file; a PNG of the pixels where they are generated.

        Raises:
            FrameError: the frame has no image, or it is gone since the build.
        """
        path = self._file(row)
        if path is None:
            return EncodedImage(self._made(row), _MADE)
        try:
            return EncodedImage(path.read_bytes(), self._suffix(row))
        except OSError as error:
            raise self._gone(row, error) from error

    def place_all(self, folder: Path) -> int:
        """Put every image there is where `place` puts it; returns their number.

        Raises:
            FrameError: an image is gone since the build.
        """
        rows = [row for row, there in enumerate(self._has_image) if there]
        if rows:
            (folder / self._part.sequence).mkdir(parents=True, exist_ok=True)
        for row in rows:
            self.place(row, folder)
        return len(rows)

    def place(self, row: int, folder: Path) -> None:
        """Put the image at `folder / name(row)`: a link to the dataset's file, else a PNG.

        Raises:
            FrameError: the frame has no image, or it is gone since the build.
        """
        self.put(row, folder / self.name(row))

    def put(self, row: int, target: Path) -> None:
        """Put the image at a path: a link to a file of the same kind, else a PNG.

        Raises:
            FrameError: the frame has no image, or it is gone since the build.
        """
        target.unlink(missing_ok=True)
        path = self._file(row)
        if path is None or self._suffix(row) != target.suffix:
            target.write_bytes(self._made(row))
            return
        try:
            target.symlink_to(path.resolve(strict=True))
        except FileNotFoundError as error:
            raise self._gone(row, error) from error
        except (OSError, NotImplementedError):
            # A file system without links, or a user who may make none.
            shutil.copyfile(path, target)

    def _file(self, row: int) -> Path | None:
        path = self._paths[row]
        return None if path is None else Path(self._part.root) / path

    def _suffix(self, row: int) -> str:
        path = self._paths[row]
        return _MADE if path is None else Path(path).suffix.lower()

    def _made(self, row: int) -> bytes:
        """Return the PNG of an image that the dataset makes and keeps in no file."""
        from PIL import Image

        number = self._numbers[row]
        if not self._has_image[row] or number not in self._frames:
            raise FrameError(
                f"frame {number} of '{self._part.sequence}' has no image: "
                "choose frames that have one with --where"
            )
        buffer = io.BytesIO()
        pixels = self._dataset.read_image(self._frames[number])
        Image.fromarray(pixels).save(buffer, "PNG", compress_level=1)
        return buffer.getvalue()

    def _gone(self, row: int, error: OSError) -> FrameError:
        return FrameError(
            f"image {self._file(row)} of frame {self._numbers[row]} of '{self._part.sequence}' "
            f"cannot be read ({error.strerror}): put it back, or build again"
        )

    @cached_property
    def _dataset(self) -> Dataset:
        opened: Dataset = registry.find("datasets", self._part.dataset).open_dataset(
            self._part.root
        )
        return opened

    @cached_property
    def _frames(self) -> dict[int, Frame]:
        return {frame.frame: frame for frame in self._dataset.frames(self._part.sequence)}


def image_line(options: ExportOptions) -> str:
    """Return what a card says of the images of a format that keeps them as files."""
    if options.labels_only:
        return "named, not written: --labels-only"
    return "links to the dataset's files, PNGs where it has none"
