"""PNG files: their size and whether they are whole, without decoding; and their pixels."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.types import FloatArray, ImageArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES = 24
_TAIL_BYTES = 64
_AROUND_CHUNK_BYTES = 12


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
        FrameError: the file cannot be read or decoded.
    """
    import cv2

    try:
        data = path.read_bytes()
    except OSError as error:
        raise FrameError(f"image {path.name} cannot be read: {error.strerror}") from error
    # OpenCV is the fastest to decode, but returns what it could of a damaged file without a word.
    if wrong := damaged_chunk(data):
        raise FrameError(f"image {path.name} cannot be decoded: {wrong}")
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise FrameError(f"image {path.name} cannot be decoded: its pixels are no PNG's")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB, dst=image), dtype=np.uint8)


def damaged_chunk(data: bytes) -> str | None:
    """Return which part of a PNG is not as it was written, in a few words; None when all are.

    Each chunk is its length, its kind, its content, and the CRC-32 of kind and content; the last
    is IEND.
    """
    view, place = memoryview(data), len(_SIGNATURE)
    if not data.startswith(_SIGNATURE):
        return "it is not a PNG"
    while place + _AROUND_CHUNK_BYTES <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        end = place + _AROUND_CHUNK_BYTES + length
        if end > len(data):
            break
        (written,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(view[place + 4 : end - 4]) != written:
            return f"the chunk {kind.decode('latin-1')} at byte {place} is damaged"
        if kind == b"IEND":
            return None
        place = end
    return f"it is cut short ({len(data)} bytes)"


def read_grey16(path: Path) -> FloatArray:
    """Return the (H, W) steps, 0 to 65,535, of a grey image of 16 bits.

    Raises:
        FrameError: the file cannot be read or decoded, or has colours or 8 bits.
    """
    from PIL import Image

    try:
        data = path.read_bytes()
    except OSError as error:
        raise FrameError(f"image {path.name} cannot be read: {error.strerror}") from error
    # Pillow passes over the checksums of the pixels.
    if wrong := damaged_chunk(data):
        raise FrameError(f"image {path.name} cannot be decoded: {wrong}")
    try:
        with Image.open(io.BytesIO(data)) as image:
            if not image.mode.startswith("I"):
                raise FrameError(f"image {path.name} is no grey image of 16 bits")
            return np.asarray(image, dtype=np.float64)
    except (OSError, SyntaxError, ValueError) as error:
        raise FrameError(f"image {path.name} cannot be decoded: {error}") from error
