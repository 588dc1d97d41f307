"""PNG files: their size and whether they are whole, without decoding; and their pixels."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.types import FloatArray, ImageArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES = 24
_TAIL_BYTES = 64


def png_size(path: Path) -> tuple[int, int]:
    """Return (width, height) in pixels from the header of a PNG that ends as a PNG does.

    Raises:
        FrameError: the file cannot be read, is no PNG, or is cut short.
    """
    try:
        with path.open("rb", buffering=0) as file:
            header = file.read(_HEADER_BYTES)
            end = file.seek(0, os.SEEK_END)
            file.seek(max(0, end - _TAIL_BYTES))
            tail = file.read(_TAIL_BYTES)
    except OSError as error:
        raise FrameError(f"image {path.name} cannot be read: {error.strerror}") from error
    if len(header) < _HEADER_BYTES or not header.startswith(_SIGNATURE):
        raise FrameError(f"image {path.name} is not a PNG: fetch it again")
    if b"IEND" not in tail:
        raise FrameError(f"image {path.name} is cut short ({end} bytes): fetch it again")
    width, height = struct.unpack(">II", header[16:24])
    return width, height


def read_rgb(path: Path) -> ImageArray:
    """Return the (H, W, 3) RGB pixels.

    Raises:
        FrameError: the file cannot be decoded.
    """
    # Pillow refuses a damaged file, where OpenCV returns the part it could decode.
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"), dtype=np.uint8)
    except (OSError, SyntaxError, ValueError) as error:
        raise FrameError(f"image {path.name} cannot be decoded: {error}") from error


def read_grey16(path: Path) -> FloatArray:
    """Return the (H, W) steps, 0 to 65,535, of a grey image of 16 bits.

    Raises:
        FrameError: the file cannot be decoded, or has colours or 8 bits.
    """
    from PIL import Image

    try:
        with Image.open(path) as image:
            if not image.mode.startswith("I"):
                raise FrameError(f"image {path.name} is no grey image of 16 bits")
            return np.asarray(image, dtype=np.float64)
    except (OSError, SyntaxError, ValueError) as error:
        raise FrameError(f"image {path.name} cannot be decoded: {error}") from error
