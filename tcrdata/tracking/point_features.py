"""What templates are correlated in where no detector is: unit vectors of colour or reflectance."""

from __future__ import annotations

import numpy as np

from tcrdata.tracking.near_points import unit_directions, unit_rows
from tcrdata.types import Float32Array, ImageArray

_HUE, _GREY = np.float32(1.2), np.float32(1.5)
_OCCUPIED = 1.5


def colour_features(image: ImageArray, pixels: np.ndarray) -> Float32Array:
    """Return (N, 5) unit vectors: occupancy, the hue as it stands out of the grey, and the grey.

    The hue is taken relative to the grey: it is the same on a thing's dark side.
    """
    colours = image[pixels[:, 1], pixels[:, 0]].astype(np.float32) / np.float32(255)
    grey = colours.mean(axis=1, keepdims=True)
    hue = _HUE * (colours - grey) / (grey + np.float32(0.1))
    return unit(np.column_stack([np.ones_like(grey), hue, _GREY * (grey - 0.35)]))


def reflectance_features(reflectance: Float32Array) -> Float32Array:
    """Return (N, 3) unit vectors: occupancy, and the reflectance as a direction."""
    angle = reflectance.astype(np.float32) * np.float32(np.pi)
    return unit_directions(np.cos(angle), np.sin(angle), _OCCUPIED)


def unit(features: np.ndarray) -> Float32Array:
    """Return rows of length 1."""
    return unit_rows(np.ascontiguousarray(features))
