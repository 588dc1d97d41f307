"""Files of optical flow and of image pairs: Middlebury `.flo`, KITTI 16-bit PNG, FlyingChairs.

A flow is (H, W, 2) float32 in pixels (column, row) from the first image to the second, NaN where it
is not known.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from tcrdata.errors import DatasetError
from tcrdata.types import Float32Array, ImageArray

FLO_TAG = b"PIEH"
UNKNOWN_FLO = np.float32(1e10)
"""Written where flow is not known; what is larger than a tenth of it is read so."""

KITTI_STEPS_A_PX = 64
KITTI_ZERO = 2**15
_GAP = rb"(?:\s|#[^\n]*\n)+"
_PPM_HEADER = re.compile(rb"P6" + _GAP + rb"(\d+)" + _GAP + rb"(\d+)" + _GAP + rb"255\s")
_HEADER = struct.Struct("<4sii")


def read_flo(path: Path) -> Float32Array:
    """Return the flow of a Middlebury `.flo` file, as FlyingChairs and Sintel have it, too.

    Raises:
        DatasetError: the file cannot be read, is no `.flo`, or is cut short.
    """
    data = _bytes(path)
    tag, width, height = _HEADER.unpack(data[: _HEADER.size].ljust(_HEADER.size, b"\0"))
    if tag != FLO_TAG or min(width, height) < 1:
        raise DatasetError(f"{path}: no .flo file: it does not begin with {FLO_TAG.decode()}")
    wanted = _HEADER.size + 8 * width * height
    if len(data) != wanted:
        raise DatasetError(
            f"{path}: {len(data)} bytes, not {wanted} for {width}x{height}: fetch it again"
        )
    flow = np.frombuffer(data, "<f4", offset=_HEADER.size).reshape(height, width, 2)
    unknown = (~(np.abs(flow) <= UNKNOWN_FLO / 10)).any(axis=2, keepdims=True)
    return np.where(unknown, np.float32(np.nan), flow).astype(np.float32)


def write_flo(path: Path, flow: Float32Array) -> None:
    """Write a Middlebury `.flo` file; every known value is kept to the bit."""
    height, width, _ = flow.shape
    known = np.where(np.isnan(flow).any(axis=2, keepdims=True), UNKNOWN_FLO, flow)
    path.write_bytes(_HEADER.pack(FLO_TAG, width, height) + known.astype("<f4").tobytes())


def read_kitti_flow(path: Path) -> Float32Array:
    """Return the flow of a KITTI 16-bit PNG: red u, green v as `(px + 512) * 64`, blue known.

    Raises:
        DatasetError: the file cannot be read, or is no PNG of three 16-bit channels.
    """
    import cv2

    data = np.frombuffer(_bytes(path), np.uint8)
    encoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if encoded is None or encoded.dtype != np.uint16 or encoded.shape[2:] != (3,):
        raise DatasetError(f"{path}: no KITTI flow: it is no whole PNG of three 16-bit channels")
    known, v, u = (encoded[..., channel] for channel in range(3))
    steps = np.stack([u, v], axis=2).astype(np.float32) - KITTI_ZERO
    every = np.asarray(known > 0)[..., None]
    return np.where(every, steps / KITTI_STEPS_A_PX, np.float32(np.nan)).astype(np.float32)


def write_kitti_flow(path: Path, flow: Float32Array) -> None:
    """Write a KITTI 16-bit PNG; values are rounded to 1/64 px.

    Raises:
        DatasetError: a flow does not fit the format, which ends at -512 and 512 px.
    """
    import cv2

    known = np.asarray(np.isfinite(flow).all(axis=2))
    steps = np.rint(np.where(known[..., None], flow, 0) * KITTI_STEPS_A_PX) + KITTI_ZERO
    if steps.min(initial=0) < 0 or steps.max(initial=0) > 2**16 - 1:
        largest = float(np.abs(flow[known]).max())
        raise DatasetError(
            f"{path}: a flow of {largest:.1f} px does not fit a KITTI PNG (512 px): write .flo"
        )
    steps[~known] = 0
    encoded = np.dstack([known, steps[..., 1], steps[..., 0]]).astype(np.uint16)
    _, data = cv2.imencode(".png", encoded)
    path.write_bytes(data.tobytes())


def read_flow_file(path: Path) -> Float32Array:
    """Return the flow of a file by its ending: `.flo`, or `.png` as KITTI has it.

    Raises:
        DatasetError: it cannot be read as what it is named.
    """
    return read_kitti_flow(path) if path.suffix == ".png" else read_flo(path)


def read_ppm(path: Path) -> ImageArray:
    """Return the (H, W, 3) RGB pixels of a binary `.ppm` of 8 bits, as FlyingChairs has them.

    Raises:
        DatasetError: the file cannot be read, is something else, or is cut short.
    """
    data = _bytes(path)
    header = _PPM_HEADER.match(data)
    width, height = (int(header[1]), int(header[2])) if header else (0, 0)
    if header is None or min(width, height) < 1:
        raise DatasetError(
            f"{path}: no binary .ppm of 8 bits: it does not begin with P6 and a size"
        )
    wanted = header.end() + 3 * width * height
    if len(data) < wanted:
        raise DatasetError(
            f"{path}: {len(data)} bytes, not {wanted} for {width}x{height}: fetch it again"
        )
    pixels = np.frombuffer(data, np.uint8, 3 * width * height, header.end())
    return pixels.reshape(height, width, 3)


def write_ppm(path: Path, image: ImageArray) -> None:
    """Write an (H, W, 3) RGB image as a binary `.ppm`, as FlyingChairs has them."""
    height, width, _ = image.shape
    path.write_bytes(b"P6\n%d %d\n255\n" % (width, height) + image.tobytes())


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from error
