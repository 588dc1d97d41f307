"""Generated image pairs with exact flow: textured planes before one another, each moved on its own.

A plane's motion is a homography: flow at p is `dehom(H [p, 1]) - p` of the topmost plane there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tcrdata.errors import SettingsError
from tcrdata.types import BoolArray, Float32Array, FloatArray


@dataclass(frozen=True)
class PlaneSettings:
    """What planes are drawn and how they move.

    Attributes:
        height_px: of the images.
        width_px: of the images.
        planes: at most so many before the background: many small motions teach more than one large.
        still: share of the pairs whose background does not move, as before a camera that stands.
        plain: share of the planes that show hardly any texture, as sky, road and walls do.
        shift_px: scale of a plane's shift; half of all shifts are smaller.
        turn_rad: largest turn in the image.
        zoom: largest change of size, as a share.
        tilt: largest change of size from the middle of the image to its rim, as a share.
        brightness: largest change of gain and gamma between the images, as a share.
        noise: largest standard deviation of the pixels' noise, of 1.
    """

    height_px: int = 128
    width_px: int = 192
    planes: int = 12
    still: float = 0.2
    plain: float = 0.0
    shift_px: float = 8.0
    turn_rad: float = 0.1
    zoom: float = 0.1
    tilt: float = 0.05
    brightness: float = 0.15
    noise: float = 0.02

    def __post_init__(self) -> None:
        if min(self.height_px, self.width_px) < 64:
            raise SettingsError(
                f"generated pairs of {self.width_px}x{self.height_px} px: flow is learnt on 64 px "
                "and more a side"
            )


class FlowPair(NamedTuple):
    """Two images and the flow between them.

    Attributes:
        first: (H, W, 3) float32 in [0, 1].
        second: the same.
        flow: (H, W, 2) float32, px (column, row), from the first to the second.
        known: (H, W) bool: where it is known.
    """

    first: Float32Array
    second: Float32Array
    flow: Float32Array
    known: BoolArray


def textured_planes(settings: PlaneSettings, rng: np.random.Generator) -> FlowPair:
    """Return a pair drawn with these random numbers."""
    height, width = settings.height_px, settings.width_px
    first, second = (np.zeros((height, width, 3), np.float32) for _ in range(2))
    flow = np.zeros((height, width, 2), np.float32)
    moving = rng.random() >= settings.still
    background = _motion(settings, settings.shift_px, rng) if moving else np.eye(3)
    for number in range(int(rng.integers(0, settings.planes + 1)) + 1):
        own = np.eye(3) if number == 0 else _motion(settings, settings.shift_px, rng)
        moved = own @ background if rng.random() < 0.7 else own
        moved = background if number == 0 else moved
        place = _jitter(height, width, rng)
        canvas = np.dstack([_texture(settings, rng), _outline(number, height, width, rng)])
        shown = _drawn(canvas, place, (height, width))
        later = _drawn(canvas, moved @ place, (height, width))
        first += shown[..., 3:] * (shown[..., :3] - first)
        second += later[..., 3:] * (later[..., :3] - second)
        on_top = shown[..., 3] > 0.5
        flow[on_top] = _homography_flow(moved, height, width)[on_top]
    first, second = photographed(first, second, settings, rng)
    return FlowPair(first, second, flow, np.ones((height, width), bool))


def _motion(settings: PlaneSettings, shift_px: float, rng: np.random.Generator) -> FloatArray:
    """A random homography about the middle of the image, near the identity."""
    height, width = settings.height_px, settings.width_px
    middle = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1.0]])
    strength = rng.random()
    turn = settings.turn_rad * strength * rng.uniform(-1, 1)
    size = 1 + settings.zoom * strength * rng.uniform(-1, 1)
    # The median of an exponential is ln 2 of its mean.
    length, heading = rng.exponential(shift_px / np.log(2)), rng.uniform(0, 2 * np.pi)
    length = min(length, 0.4 * min(height, width))
    tilt = settings.tilt * strength * rng.uniform(-1, 1, 2) / (width / 2)
    cosine, sine = size * np.cos(turn), size * np.sin(turn)
    own = np.array([
        [cosine, -sine, length * np.cos(heading)],
        [sine, cosine, length * np.sin(heading)],
        [*tilt, 1.0],
    ])  # fmt: skip
    moved: FloatArray = np.linalg.inv(middle) @ own @ middle
    return moved


def _homography_flow(moved: FloatArray, height: int, width: int) -> Float32Array:
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    start = np.stack([columns, rows, np.ones_like(rows)], axis=-1).astype(np.float64)
    end = start @ moved.T
    flow: Float32Array = (end[..., :2] / end[..., 2:] - start[..., :2]).astype(np.float32)
    return flow


def _jitter(height: int, width: int, rng: np.random.Generator) -> FloatArray:
    """A place of a canvas in the first image, between pixels: both images are resampled."""
    turn, size = rng.uniform(-0.5, 0.5), rng.uniform(0.9, 1.3)
    side = _canvas_side(height, width)
    own = size * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    offset = np.array([width / 2, height / 2]) - own @ np.array([side / 2, side / 2])
    return np.vstack([np.column_stack([own, offset + rng.random(2)]), [0, 0, 1]])


def _canvas_side(height: int, width: int) -> int:
    return int(1.3 * np.hypot(height, width))


def _drawn(canvas: Any, place: FloatArray, shape: tuple[int, int]) -> Float32Array:
    """The canvas (S, S, 4) in an image; its border reflected for colours, empty for the outline."""
    import cv2

    size = (shape[1], shape[0])
    colours = cv2.warpPerspective(
        canvas[..., :3], place, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    # A background without an end: its outline is one everywhere.
    outline = cv2.warpPerspective(
        canvas[..., 3], place, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    drawn: Float32Array = np.dstack([colours, outline])
    return drawn


def _texture(settings: PlaneSettings, rng: np.random.Generator) -> Float32Array:
    """(S, S, 3) noise of several octaves in random colours, with spots and lines if not plain."""
    import cv2

    side = _canvas_side(settings.height_px, settings.width_px)
    base, contrast = rng.uniform(0.15, 0.85, 3), rng.uniform(0.1, 0.6)
    # Without plain ones the numbers drawn stay what they are without the setting.
    plain = settings.plain > 0 and rng.random() < settings.plain
    contrast *= rng.uniform(0.0, 0.2) if plain else 1.0
    fading = rng.uniform(0.5, 0.95)
    grey = np.zeros((side, side), np.float32)
    total = 0.0
    for octave in range(6):
        cells = min(max(4 * 2**octave, 4), side)
        noise = rng.random((cells, cells), dtype=np.float32) - 0.5
        grey += fading**octave * cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC)
        total += fading**octave
    tint = 1 + rng.uniform(-0.5, 0.5, 3)
    painted = np.ascontiguousarray(base + contrast * 4 / total * grey[..., None] * tint, np.float32)
    for _ in range(0 if plain else int(rng.integers(0, 25))):
        colour = [float(c) for c in rng.random(3)]
        ends = rng.integers(0, side, 4).tolist()
        if rng.random() < 0.5:
            cv2.circle(painted, tuple(ends[:2]), int(rng.integers(2, 24)), colour, -1, cv2.LINE_AA)
        else:
            width_px = int(rng.integers(1, 6))
            cv2.line(painted, tuple(ends[:2]), tuple(ends[2:]), colour, width_px, cv2.LINE_AA)
    return np.clip(painted, 0, 1)


def _outline(number: int, height: int, width: int, rng: np.random.Generator) -> Float32Array:
    """(S, S) of ones inside a random polygon somewhere in the image; everywhere for number 0."""
    import cv2

    side = _canvas_side(height, width)
    if number == 0:
        return np.ones((side, side), np.float32)
    outline = np.zeros((side, side), np.float32)
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 12))))
    radii = rng.uniform(0.5, 1.0, len(angles)) * rng.uniform(0.08, 0.35) * width
    middle = side / 2 + rng.uniform(-0.5, 0.5, 2) * (width, height)
    corners = middle + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    cv2.fillPoly(outline, [corners.astype(np.int32)], 1.0, cv2.LINE_8)
    return outline


def photographed(
    first: Float32Array, second: Float32Array, settings: PlaneSettings, rng: np.random.Generator
) -> tuple[Float32Array, Float32Array]:
    """Return both images, (H, W, 3) in [0, 1], with a light and a noise of their own."""
    found = []
    spread = rng.uniform(0, settings.noise)
    for image in (first, second):
        gain, gamma = 1 + settings.brightness * rng.uniform(-1, 1, 2)
        lit = gain * np.clip(image, 0, 1) ** gamma
        noisy = lit + spread * rng.standard_normal(image.shape, dtype=np.float32)
        found.append(np.clip(noisy, 0, 1).astype(np.float32))
    return found[0], found[1]
