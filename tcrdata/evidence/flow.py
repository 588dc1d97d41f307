"""Optical flow of consecutive frames, both directions, with both cycle tests kept as numbers.

The estimator is OpenCV's DIS, or RAFT with the weights of a model in the store. Nothing is gated:
the tests are bit planes and shares. Frames without an image that can be read have no rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import FrameError, SettingsError
from tcrdata.evidence import flow_cycle
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.flow_estimators import METHODS, Dis, Estimator, Raft
from tcrdata.evidence.models import ModelChoice, read_model
from tcrdata.evidence.point_rows import error_rows
from tcrdata.evidence.stored_flow import Pair, image_pairs
from tcrdata.store import Store
from tcrdata.store.arrays import encode_bits, encode_flow
from tcrdata.types import CueInput, Dataset, Float32Array, ImageArray, Rows, Tables

NEEDS: tuple[str, ...] = ()
GIVES: tuple[str, ...] = ("flows",)
NEEDS_IMAGES: bool = True
MODEL_KIND = "flow"


@dataclass(frozen=True)
class Settings:
    """How flow is estimated and tested.

    Attributes:
        method: dis or raft.
        model: id of RAFT's model, or its beginning.
        model_store: store that holds it; empty for this one.
        iterations: RAFT's corrections of the flow.
        cycle_share: alpha 1 of the cycle tests.
        cycle_slack_px: alpha 2 of the cycle tests.
        pairs_per_task: frame pairs a worker takes at once; neighbours share an image read.
    """

    method: str = "dis"
    model: str = ""
    model_store: str = ""
    iterations: int = 8
    cycle_share: float = 0.05
    cycle_slack_px: float = 0.5
    pairs_per_task: int = 8

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise SettingsError(f"flow.method: '{self.method}' is none of {', '.join(METHODS)}")


@dataclass(frozen=True)
class _Task:
    dataset: Dataset
    pairs: tuple[Pair, ...]
    settings: Settings
    estimator: Estimator


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `flows`: two rows a pair of consecutive frames with images."""
    settings: Settings = cue.settings
    pairs = image_pairs(cue.frames)
    if not pairs:
        return
    estimator = chosen_estimator(cue.tables, settings, cue.round)
    tasks = (
        _Task(cue.dataset, part, settings, estimator)
        for part in chunked(pairs, settings.pairs_per_task)
    )
    for batches in cue.parallel(_measure_task, tasks):
        yield from batches


def chosen_estimator(
    tables: Tables | Store, settings: Settings, round: int = 1, threads: int = 1, device: str = ""
) -> Estimator:
    """Return what the settings name.

    Args:
        tables: may hold RAFT's model; or the store that does.
        settings: method, model and iterations.
        round: EM round.
        threads: torch's, of RAFT.
        device: torch's, of RAFT; empty for the GPU where there is one.

    Raises:
        EvidenceError: there is no such model.
    """
    if settings.method == "dis":
        return Dis()
    wanted = ModelChoice(MODEL_KIND, settings.model, settings.model_store, round)
    model = read_model(tables, wanted)
    return Raft(model.model_id, model.plain, model.weights, settings.iterations, threads, device)


def flow_rows(
    pair: Pair,
    forward: Float32Array,
    backward: Float32Array,
    settings: Settings,
    method: str = "dis",
) -> dict[str, list[Any]]:
    """Return the two rows of a pair: tests, shares and encoded flow."""
    here = flow_cycle.measure(forward, backward, settings.cycle_share, settings.cycle_slack_px)
    there = flow_cycle.measure(backward, forward, settings.cycle_share, settings.cycle_slack_px)
    release_here, release_there = flow_cycle.one_to_one(forward, backward, here, there)
    ends = (pair.first.frame, pair.second.frame)
    rows = [
        {"frame": ends[0], "frame_to": ends[1], "direction": "forward"}
        | _columns(forward, here, release_here, method),
        {"frame": ends[1], "frame_to": ends[0], "direction": "backward"}
        | _columns(backward, there, release_there, method),
    ]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _columns(
    flow: Float32Array, cycle: flow_cycle.Cycle, release: Any, method: str
) -> dict[str, Any]:
    codec, data = encode_flow(flow)
    planes = cycle.paper * np.uint8(flow_cycle.PAPER_BIT) | release * np.uint8(
        flow_cycle.RELEASE_BIT
    )
    inside = cycle.error_px[np.isfinite(cycle.error_px)]
    return {
        "method": method,
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
    known: dict[int, ImageArray] = {}
    errors: dict[int, str] = {}
    batches: list[Rows] = []
    for pair in task.pairs:
        images = _images(task.dataset, pair, known, errors)
        if images is None:
            continue
        known = {pair.second.frame: images[1]}
        forward, backward = task.estimator.both_ways(*images)
        rows = flow_rows(pair, forward, backward, task.settings, task.estimator.method)
        batches.append(Rows("flows", rows))
    return [*batches, *error_rows(sorted(errors.items()))]


def _images(
    dataset: Dataset, pair: Pair, known: dict[int, ImageArray], errors: dict[int, str]
) -> tuple[ImageArray, ImageArray] | None:
    """Return both images; or None, and say which frame is to blame."""
    images = []
    for frame in pair:
        try:
            images.append(known[frame.frame] if frame.frame in known else dataset.read_image(frame))
        except FrameError as error:
            errors[frame.frame] = str(error)
            return None
    first, second = images
    if first.shape[:2] != second.shape[:2]:
        (h1, w1), (h2, w2) = first.shape[:2], second.shape[:2]
        errors[pair.first.frame] = (
            f"frame {pair.first.frame}: image is {w1}x{h1} but frame {pair.second.frame} has "
            f"{w2}x{h2}; flow needs one size: leave one of the frames out"
        )
        return None
    return first, second
