"""Optical flow of consecutive frames, both directions, with both cycle tests kept as numbers.

The estimator is OpenCV's DIS (Kroeger et al., "Fast optical flow using dense inverse search",
ECCV 2016). Nothing is gated: the tests are bit planes and shares. Frames without an image that
can be read have no rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence import flow_cycle
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.point_rows import error_rows
from tcrdata.evidence.stored_flow import Pair, image_pairs
from tcrdata.store.arrays import encode_bits, encode_flow
from tcrdata.types import CueInput, Dataset, Float32Array, Frame, ImageArray, Rows

NEEDS: tuple[str, ...] = ()
GIVES: tuple[str, ...] = ("flows",)
NEEDS_IMAGES: bool = True
METHOD = "dis"


@dataclass(frozen=True)
class Settings:
    """How flow is estimated and tested.

    Attributes:
        cycle_share: alpha 1 of the cycle tests.
        cycle_slack_px: alpha 2 of the cycle tests.
        pairs_per_task: frame pairs a worker takes at once; neighbours share an image read.
    """

    cycle_share: float = 0.05
    cycle_slack_px: float = 0.5
    pairs_per_task: int = 8


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    pairs: tuple[Pair, ...]
    settings: Settings


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `flows`: two rows a pair of consecutive frames with images."""
    settings: Settings = cue.settings
    tasks = (
        _Task(cue.dataset, part, settings)
        for part in chunked(image_pairs(cue.frames), settings.pairs_per_task)
    )
    for batches in cue.parallel(_measure_task, tasks):
        yield from batches


def dis_flow(gray_from: ImageArray, gray_to: ImageArray) -> Float32Array:
    """Return the (H, W, 2) flow in pixels between two (H, W) grey images, DIS preset MEDIUM."""
    import cv2

    estimator = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    return np.asarray(estimator.calc(gray_from, gray_to, None), dtype=np.float32)


def flow_rows(
    pair: Pair, forward: Float32Array, backward: Float32Array, settings: Settings
) -> dict[str, list[Any]]:
    """Return the two rows of a pair: tests, shares and encoded flow."""
    here = flow_cycle.measure(forward, backward, settings.cycle_share, settings.cycle_slack_px)
    there = flow_cycle.measure(backward, forward, settings.cycle_share, settings.cycle_slack_px)
    release_here, release_there = flow_cycle.one_to_one(forward, backward, here, there)
    ends = (pair.first.frame, pair.second.frame)
    rows = [
        {"frame": ends[0], "frame_to": ends[1], "direction": "forward"}
        | _columns(forward, here, release_here),
        {"frame": ends[1], "frame_to": ends[0], "direction": "backward"}
        | _columns(backward, there, release_there),
    ]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _columns(flow: Float32Array, cycle: flow_cycle.Cycle, release: Any) -> dict[str, Any]:
    codec, data = encode_flow(flow)
    planes = cycle.paper * np.uint8(flow_cycle.PAPER_BIT) | release * np.uint8(
        flow_cycle.RELEASE_BIT
    )
    inside = cycle.error_px[np.isfinite(cycle.error_px)]
    return {
        "method": METHOD,
        "width_px": flow.shape[1],
        "height_px": flow.shape[0],
        "cycle_share_paper": float(cycle.paper.mean()),
        "cycle_share_release": float(release.mean()),
        "cycle_error_median_px": float(np.median(inside)) if len(inside) else None,
        "magnitude_median_px": float(np.median(np.hypot(flow[..., 0], flow[..., 1]))),
        "codec": codec,
        "data": data,
        "consistent": encode_bits(planes),
    }


def _measure_task(task: _Task) -> list[Rows]:
    import cv2

    # DIS splits the image by thread, so that its result could depend on their number.
    cv2.setNumThreads(1)
    known: dict[int, ImageArray] = {}
    errors: dict[int, str] = {}
    batches: list[Rows] = []
    for pair in task.pairs:
        images = _images(task.dataset, pair, known, errors)
        if images is None:
            continue
        first, second = images
        known = {pair.second.frame: second}
        rows = flow_rows(pair, dis_flow(first, second), dis_flow(second, first), task.settings)
        batches.append(Rows("flows", rows))
    return [*batches, *error_rows(sorted(errors.items()))]


def _images(
    dataset: Dataset, pair: Pair, known: dict[int, ImageArray], errors: dict[int, str]
) -> tuple[ImageArray, ImageArray] | None:
    """Return both grey images; or None, and say which frame is to blame."""
    images = []
    for frame in pair:
        try:
            images.append(_gray(dataset, frame, known))
        except FrameError as error:
            errors[frame.frame] = str(error)
            return None
    first, second = images
    if first.shape != second.shape:
        (h1, w1), (h2, w2) = first.shape[:2], second.shape[:2]
        errors[pair.first.frame] = (
            f"frame {pair.first.frame}: image is {w1}x{h1} but frame {pair.second.frame} has "
            f"{w2}x{h2}; flow needs one size: leave one of the frames out"
        )
        return None
    return first, second


def _gray(dataset: Dataset, frame: Frame, known: dict[int, ImageArray]) -> ImageArray:
    import cv2

    if frame.frame in known:
        return known[frame.frame]
    return np.asarray(cv2.cvtColor(dataset.read_image(frame), cv2.COLOR_RGB2GRAY))
