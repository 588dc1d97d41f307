"""Figures without global state, and PNG bytes that depend on the drawing alone."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tcrdata.types import ImageArray
from tcrdata.views.palette import BACKGROUND, GRID, MUTED, TEXT

DPI = 200


@contextmanager
def drawing(width_in: float, height_in: float) -> Iterator[Figure]:
    """Give an empty dark figure; the user's own matplotlib settings do not reach it."""
    settings = {
        **matplotlib.rcParamsDefault,
        "backend": "agg",
        "font.family": "DejaVu Sans",
        "font.size": 7.0,
        "text.color": TEXT,
        "axes.edgecolor": GRID,
        "axes.labelcolor": MUTED,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
    }
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor=BACKGROUND)
        FigureCanvasAgg(figure)
        yield figure


def rendered(figure: Figure) -> ImageArray:
    """Return the figure as an (H, W, 3) RGB image."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba", dpi=DPI, facecolor=figure.get_facecolor())
    width, height = figure.canvas.get_width_height()
    pixels = np.frombuffer(buffer.getvalue(), dtype=np.uint8)
    return pixels.reshape(height, width, 4)[:, :, :3].copy()


def png_bytes(picture: ImageArray) -> bytes:
    """Encode an (H, W, 3) RGB image, without any metadata."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, format="PNG", compress_level=6)
    return buffer.getvalue()


def png_image(data: bytes) -> ImageArray:
    """Decode a PNG to an (H, W, 3) RGB image."""
    return np.array(Image.open(io.BytesIO(data)).convert("RGB"))
