"""Two small pictures of a candidate: cut out of the camera's image, and seen from above."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import FloatArray, ImageArray, IntArray
from tcrdata.views.overlays import corners_3d, wire_frame
from tcrdata.views.report.html import number, tag, text

_PHOTO = (480, 320)
_ABOVE = (200.0, 200.0)
_ABOVE_ALONE = (500.0, 200.0)
_MOST_DOTS = 1800
_MARGIN = 0.7
_LEAST_PX = 150.0
_LEAST_HALF_M = 7.0
_NEAREST_M = 0.05
_QUALITY = 72
Boxes = Mapping[str, NDArray[np.floating]]


@dataclass(frozen=True)
class Scene:
    """What is seen around a candidate.

    Attributes:
        box: (7,) the candidate, level frame.
        kind: how it is drawn: labels, ignored or rejected.
        others: kind to (N, 7) further boxes of the frame; `truth` among them.
        projection: (3, 4) level frame to homogeneous pixels; None without a camera.
        metric_scale: metres here a metre of a road scene.
    """

    box: FloatArray
    kind: str
    others: Boxes
    projection: FloatArray | None
    metric_scale: float


def photo(image: ImageArray, scene: Scene) -> str | None:
    """Return the candidate cut out of the image, with the boxes drawn over it.

    Args:
        image: (H, W, 3) RGB.
        scene: the candidate; its projection is there.

    Returns:
        HTML, or None when the box lies outside the image.
    """
    window = _window(scene, image.shape[1], image.shape[0])
    if window is None:
        return None
    left, top, right, bottom = window
    cut = Image.fromarray(image).resize(
        _PHOTO, Image.Resampling.LANCZOS, box=(left, top, right, bottom)
    )
    buffer = io.BytesIO()
    cut.save(buffer, format="WEBP", quality=_QUALITY, method=4)
    data = base64.b64encode(buffer.getvalue()).decode()
    scale = np.array([_PHOTO[0] / (right - left), _PHOTO[1] / (bottom - top)])
    lines = _wires(scene, np.array([left, top]), scale)
    picture = (
        f'<image href="data:image/webp;base64,{data}" width="{_PHOTO[0]}" height="{_PHOTO[1]}"/>'
    )
    view = f"0 0 {_PHOTO[0]} {_PHOTO[1]}"
    return tag(
        "svg", picture, lines, viewBox=view, class_="photo", role="img",
        preserveAspectRatio="xMidYMid slice", aria_label="camera image around the candidate",
    )  # fmt: skip


def _window(scene: Scene, width: int, height: int) -> tuple[float, float, float, float] | None:
    """The part of the image to show: the box with a margin, in the picture's shape, inside."""
    assert scene.projection is not None
    corners = corners_3d(scene.box)[0]
    pixels = corners @ scene.projection[:, :3].T + scene.projection[:, 3]
    ahead = pixels[:, 2] > _NEAREST_M
    if not ahead.any():
        return None
    points = pixels[ahead, :2] / pixels[ahead, 2:]
    low = np.clip(points.min(axis=0), 0, [width, height])
    high = np.clip(points.max(axis=0), 0, [width, height])
    size = high - low
    if (size < 1).any():
        return None
    aspect = _PHOTO[0] / _PHOTO[1]
    wide = max(size[0] * (1 + 2 * _MARGIN), size[1] * (1 + _MARGIN) * aspect, _LEAST_PX)
    wide = min(wide, width, height * aspect)
    tall = wide / aspect
    centre = (low + high) / 2
    left = float(np.clip(centre[0] - wide / 2, 0, width - wide))
    top = float(np.clip(centre[1] - tall / 2, 0, height - tall))
    return left, top, left + wide, top + tall


def _wires(scene: Scene, origin: FloatArray, scale: FloatArray) -> str:
    """Wire frames of the other boxes, then of the candidate, in the cut-out's coordinates."""
    assert scene.projection is not None
    parts = []
    for kind, boxes in (*scene.others.items(), (scene.kind, scene.box[None])):
        own = boxes is not scene.others.get(kind)
        for corners in corners_3d(boxes):
            edges = (wire_frame(corners, scene.projection) - origin) * scale
            near = (edges.min(axis=1) < _PHOTO).all(axis=1) & (edges.max(axis=1) > 0).all(axis=1)
            path = "".join(
                f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}"
                for a, b in np.clip(edges[near], -2000, 2000)
            )
            parts.append(_outline(path, kind, own))
    return "".join(parts)


def _outline(path: str, kind: str, own: bool) -> str:
    """Lines of a box; the candidate's have a dark rim."""
    if not path:
        return ""
    style = f"box b-{kind}" + ("" if own or kind == "truth" else " other")
    rim = f'<path d="{path}" class="box halo"/>' if own else ""
    return f'{rim}<path d="{path}" class="{style}"/>'


def above(
    points: NDArray[np.floating], classes: IntArray, scene: Scene, alone: str | None = None
) -> str:
    """Return the points around the candidate from above, ahead of the sensor up, with the boxes.

    Args:
        points: (N, 3), level frame.
        classes: (N,) 0 = no vote, 1 = seen again, 2 = seen through.
        scene: the candidate.
        alone: why no photo stands beside it: then it is wide, and says so; None beside a photo.
    """
    width, height = _ABOVE if alone is None else _ABOVE_ALONE
    half = max(_LEAST_HALF_M * scene.metric_scale, 1.6 * float(max(scene.box[3:5])))
    scale = height / (2 * half)
    centre, middle = scene.box[[0, 2]], np.array([width, height]) / 2

    def page(xz: NDArray[np.floating]) -> FloatArray:
        moved = (xz - centre) * scale * np.array([1.0, -1.0]) + middle
        return np.asarray(moved, dtype=np.float64)

    parts = [_dots(page(points[:, [0, 2]].astype(np.float64)), classes, (width, height))]
    for kind, boxes in (*scene.others.items(), (scene.kind, scene.box[None])):
        own = boxes is not scene.others.get(kind)
        for box in np.asarray(boxes, dtype=np.float64):
            reach = middle / scale + float(max(box[3:5]))
            if (np.abs(box[[0, 2]] - centre) < reach).all():
                parts.append(_outline(_footprint(box, page), kind, own))
    parts.append(_scale_bar(half, scale, width, height))
    if alone:
        parts.append(tag("text", text(alone), x=10, y=22))
    view = f"0 0 {width:g} {height:g}"
    return tag(
        "svg", *parts, viewBox=view, class_="above", role="img",
        preserveAspectRatio="xMidYMid slice", aria_label="the same place from above",
    )  # fmt: skip


def _footprint(box: FloatArray, page: Callable[[FloatArray], FloatArray]) -> str:
    """Outline of a box from above, with a line from its centre through its front."""
    ring = page(box_corners_bev(box[None])[0])
    heading = np.array([np.cos(box[6]), -np.sin(box[6])])
    front = page(np.stack([box[[0, 2]], box[[0, 2]] + heading * (box[3] / 2 + 0.35 * box[4])]))
    outline = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in ring) + "Z"
    return outline + f"M{front[0][0]:.1f} {front[0][1]:.1f}L{front[1][0]:.1f} {front[1][1]:.1f}"


def _dots(places: FloatArray, classes: IntArray, size: tuple[float, float]) -> str:
    """Points as round dots, one a place on the page, a path a class."""
    inside = ((places >= 0) & (places <= size)).all(axis=1)
    whole = np.round(places[inside]).astype(np.int64)
    kinds = np.asarray(classes)[inside]
    # Of several points at one place the one seen through matters most.
    keys, first = np.unique(
        (whole[:, 0] * 1000 + whole[:, 1])[np.argsort(-kinds, kind="stable")], return_index=True
    )
    kinds = np.sort(-kinds, kind="stable")[first] * -1
    parts = []
    for kind in (0, 1, 2):
        chosen = keys[kinds == kind]
        chosen = chosen[:: max(1, -(-len(chosen) // _MOST_DOTS))]
        path = "".join(f"M{key // 1000} {key % 1000}h0" for key in chosen.tolist())
        if path:
            parts.append(f'<path d="{path}" class="dots d{kind}"/>')
    return "".join(parts)


def _scale_bar(half: float, scale: float, width: float, height: float) -> str:
    """A bar of 1, 2 or 5 times a power of ten metres, about a third of the width."""
    power = 10.0 ** np.floor(np.log10(half * 0.8))
    length = float(max(step * power for step in (1, 2, 5) if step * power <= half * 0.8))
    right, y = width - 10, height - 10
    left = right - length * scale
    name = text(f"{number(length)} m")
    return (
        f'<text x="{(left + right) / 2:.1f}" y="{y - 5:.1f}" text-anchor="middle">{name}</text>'
        f'<line x1="{left:.1f}" y1="{y}" x2="{right}" y2="{y}" class="bar"/>'
    )


def missing(message: str) -> str:
    """What stands in the place of a picture that cannot be drawn."""
    return tag("div", text(message), class_="missing")
