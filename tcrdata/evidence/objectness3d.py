"""3D objectness: where a trained detector sees objects, and how sure it is of every proposal.

Its boxes become proposals of source `detector`, however faint; every proposal of earlier rounds,
whatever its source, gets a confidence of module `objectness_3d`: the largest heat in its footprint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.detector_looks import looked
from tcrdata.evidence.models import Model, ModelChoice, network_of, read_model
from tcrdata.evidence.objectness_boxes import (
    SOURCE,
    detected_columns,
    on_the_ground,
)
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching, error_rows, read_encoded
from tcrdata.evidence.proposal_columns import Columns
from tcrdata.types import BOX_COLUMNS, CueInput, Dataset, FloatArray, Frame, Rows, Sensor

NEEDS: tuple[str, ...] = ("ground", "odometry", "free_space")
GIVES: tuple[str, ...] = ("proposals", "confidences")
NEEDS_IMAGES: bool = False
NEEDS_MODEL = "detector"

MODULE = "objectness_3d"
EVIDENCE = ("ground", "height_m", "votes_free", "votes_static")
EVIDENCE_ROUND = 1
"""The round whose cues a network reads: geometry is measured once."""


@dataclass(frozen=True)
class Settings:
    """Which detector is run, and how its peaks become boxes.

    Attributes:
        model: id of the model, or its beginning; empty for the newest finished one of an earlier
            round.
        model_store: store that holds it; empty for this one.
        window: a peak is the largest in a square of so many output cells; odd.
        most: at most so many boxes a frame.
        least_score: what is fainter is noise, not a candidate.
        same_iou: of boxes that overlap more, from above, the surer one stays.
        mirrored: whether to look at the mirror image of each frame, too, and take the mean.
        turn_rad: the detector looks twice more, at each frame turned so much either way, and the
            boxes are fused; 0 for once.
        fused_iou: of several looks, boxes that overlap more are one object's.
        front_m: a return this much nearer hides a box's outline; times the metric scale.
        chunk_frames: frames an item of work.
        threads: torch's, in each worker.
    """

    model: str = ""
    model_store: str = ""
    window: int = 3
    most: int = 64
    least_score: float = 0.05
    same_iou: float = 0.2
    mirrored: bool = True
    turn_rad: float = 0.2
    fused_iou: float = 0.3
    front_m: float = 0.5
    chunk_frames: int = 8
    threads: int = 1


@dataclass(frozen=True)
class Known:
    """The proposals of earlier rounds in one frame.

    Attributes:
        ids: `proposal_id` of each.
        boxes: (N, 7), level frame, metres.
    """

    ids: tuple[str, ...]
    boxes: FloatArray


@dataclass(frozen=True)
class _Item:
    frame: Frame
    evidence: dict[str, EncodedPoints]
    known: Known


@dataclass(frozen=True)
class _Chunk:
    dataset: Dataset
    sensor: Sensor
    metric_scale: float
    settings: Settings
    model: Model
    items: tuple[_Item, ...]
    round: int


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `proposals` of source detector and `confidences` of module objectness_3d."""
    settings: Settings = cue.settings
    wanted = ModelChoice("detector", settings.model, settings.model_store, cue.round)
    model = read_model(cue.tables, wanted)
    chunks = (
        _Chunk(
            cue.dataset,
            cue.info.sensor,
            cue.info.metric_scale,
            settings,
            model,
            tuple(_item(cue, frame) for frame in frames),
            cue.round,
        )
        for frames in chunked(cue.frames, settings.chunk_frames)
    )
    for batches, errors in cue.parallel(_measure_chunk, chunks):
        for table, columns in batches:
            yield Rows(table, columns)
        yield from error_rows(errors)


def _item(cue: CueInput, frame: Frame) -> _Item:
    rows = (
        (name, read_encoded(cue.tables, frame.frame, name, round=EVIDENCE_ROUND))
        for name in EVIDENCE
    )
    return _Item(frame, {name: row for name, row in rows if row is not None}, _known(cue, frame))


def _known(cue: CueInput, frame: Frame) -> Known:
    """Return the first round's proposals of a frame: they stay candidates in every round."""
    table = cue.tables.read(
        "proposals",
        columns=["proposal_id", "source", *BOX_COLUMNS],
        round=EVIDENCE_ROUND,
        frame=frame.frame,
    )
    # What a detector saw in an earlier run is no candidate of others.
    table = table.filter(np.asarray(table["source"].to_numpy(zero_copy_only=False) != SOURCE))
    boxes = np.column_stack([table[name].to_numpy() for name in BOX_COLUMNS])
    return Known(tuple(table["proposal_id"].to_pylist()), boxes.reshape(-1, 7))


def _measure_chunk(
    chunk: _Chunk,
) -> tuple[list[tuple[str, Columns]], list[tuple[int, str]]]:
    """Run the network on the frames of a chunk, one after the other."""
    batches: list[tuple[str, Columns]] = []
    errors: list[tuple[int, str]] = []
    for item in chunk.items:
        if len(item.evidence) < len(EVIDENCE):
            continue
        try:
            batches += _measure(chunk, item)
        except FrameError as error:
            errors.append((item.frame.frame, str(error)))
    return batches, errors


def _measure(chunk: _Chunk, item: _Item) -> list[tuple[str, Columns]]:
    import torch

    from tcrdata.networks.decoding import DecodeSettings
    from tcrdata.networks.grids import Sweep

    torch.set_num_threads(chunk.settings.threads)
    trained = network_of(chunk.model)
    cloud = chunk.dataset.read_points(item.frame)
    evidence = {name: decode_matching(e, len(cloud)) for name, e in item.evidence.items()}
    scale = np.float32(chunk.metric_scale)
    xyz, height = cloud.xyz / scale, evidence["height_m"] / scale
    colours = _colours(chunk, item, trained.module, cloud.xyz)
    sweep = Sweep(xyz, height, evidence["ground"], colours)
    own = chunk.settings
    known = item.known.boxes.copy()
    known[:, :6] /= chunk.metric_scale
    peaks = DecodeSettings(own.window, own.most, own.least_score, own.same_iou)
    found, confidences = looked(
        trained, sweep, known, peaks,
        mirrored=own.mirrored, turn_rad=own.turn_rad, fused_iou=own.fused_iou,
    )  # fmt: skip
    boxes = on_the_ground(found.boxes, xyz, height)
    boxes[:, :6] *= chunk.metric_scale
    columns = detected_columns(
        boxes, item.frame, chunk.sensor, cloud.xyz, evidence, own.front_m, chunk.metric_scale,
        chunk.round,
    )  # fmt: skip
    ids = [*columns["proposal_id"], *item.known.ids]
    values = [*found.scores.tolist(), *confidences]
    rows = _confidences(item.frame.frame, ids, values)
    return [("proposals", columns), ("confidences", rows)] if ids else []


def _colours(chunk: _Chunk, item: _Item, module: Any, xyz: Any) -> Any:
    """Return (N, 3) colours where the network wants them, else zeros."""
    from tcrdata.networks.grids import pixel_colours

    image = None
    if getattr(module, "NEEDS_COLOURS", False) and item.frame.has_image:
        image = chunk.dataset.read_image(item.frame)
    return pixel_colours(image, item.frame, xyz)


def _confidences(frame: int, ids: list[str], values: list[float | None]) -> Columns:
    count = len(ids)
    return {
        "proposal_id": ids,
        "frame": [frame] * count,
        "module": [MODULE] * count,
        "confidence": values,
        "raw_value": values,
        "unit": ["probability of a centre"] * count,
    }
