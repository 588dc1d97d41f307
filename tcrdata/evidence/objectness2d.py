"""2D objectness: how surely a trained segmenter takes the pixels of each proposal for an object's.

Every proposal of the first round and of this one gets a confidence of module `objectness_2d`: the
mean objectness of the pixels that its points project to. Frames without an image get none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcrdata.errors import FrameError
from tcrdata.evidence.chunks import chunked
from tcrdata.evidence.frame_proposals import FrameProposals, frame_proposals
from tcrdata.evidence.models import Model, ModelChoice, network_of, read_model
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching, error_rows
from tcrdata.evidence.proposal_columns import Columns
from tcrdata.geometry.boxes import points_in_box
from tcrdata.types import CueInput, Dataset, ImageArray, Rows

NEEDS: tuple[str, ...] = ("ground", "detected_objects")
GIVES: tuple[str, ...] = ("confidences",)
NEEDS_IMAGES: bool = True
NEEDS_MODEL = "segmenter"

MODULE = "objectness_2d"


@dataclass(frozen=True)
class Settings:
    """Which segmenter is run, and on what.

    Attributes:
        model: id of the model, or its beginning; empty for the newest finished one of an earlier
            round.
        model_store: store that holds it; empty for this one.
        scale: of the images that the network sees, as in its training.
        fewest_points: a proposal with fewer points in the image has no evidence.
        chunk_frames: frames an item of work.
        threads: torch's, in each worker.
    """

    model: str = ""
    model_store: str = ""
    scale: float = 0.5
    fewest_points: int = 3
    chunk_frames: int = 8
    threads: int = 1


@dataclass(frozen=True)
class _Chunk:
    dataset: Dataset
    settings: Settings
    model: Model
    items: tuple[FrameProposals, ...]


def run(cue: CueInput) -> Iterator[Rows]:
    """Yield `confidences` of module objectness_2d; nothing for a drive without images."""
    settings: Settings = cue.settings
    frames = [frame for frame in cue.frames if frame.has_image]
    if not frames:
        return
    wanted = ModelChoice(NEEDS_MODEL, settings.model, settings.model_store, cue.round)
    model = read_model(cue.tables, wanted)
    chunks = (
        _Chunk(cue.dataset, settings, model, tuple(frame_proposals(cue, frame) for frame in part))
        for part in chunked(frames, settings.chunk_frames)
    )
    for batches, errors in cue.parallel(_measure_chunk, chunks):
        for columns in batches:
            yield Rows("confidences", columns)
        yield from error_rows(errors)


def _measure_chunk(chunk: _Chunk) -> tuple[list[Columns], list[tuple[int, str]]]:
    batches: list[Columns] = []
    errors: list[tuple[int, str]] = []
    for item in chunk.items:
        if item.ground is None or not item.ids:
            continue
        try:
            batches.append(_measure(chunk, item, item.ground))
        except FrameError as error:
            errors.append((item.frame.frame, str(error)))
    return batches, errors


def _measure(chunk: _Chunk, item: FrameProposals, ground: EncodedPoints) -> Columns:
    from tcrdata.networks.grids import projected

    image = chunk.dataset.read_image(item.frame)
    cloud = chunk.dataset.read_points(item.frame)
    solid = cloud.xyz[~decode_matching(ground, len(cloud))]
    pixels = projected(item.frame, solid)
    seen = np.isfinite(pixels[:, 0])
    heat = objectness(image, chunk.model, chunk.settings)
    column, line = pixels[seen].astype(np.int64).T
    values = heat[line, column]
    xyz = solid[seen]
    means: list[float | None] = []
    for box in item.boxes:
        inside = points_in_box(xyz, box)
        enough = int(inside.sum()) >= chunk.settings.fewest_points
        means.append(float(values[inside].mean(dtype=np.float64)) if enough else None)
    return item.confidences(MODULE, means, means, "probability of an object")


def objectness(image: ImageArray, model: Model, settings: Settings) -> NDArray[np.float32]:
    """Return the (H, W) objectness in [0, 1] of an (H, W, 3) image."""
    import cv2
    import torch

    torch.set_num_threads(settings.threads)
    height, width = image.shape[:2]
    small = cv2.resize(
        image, None, fx=settings.scale, fy=settings.scale, interpolation=cv2.INTER_AREA
    )
    batch = torch.from_numpy(np.moveaxis(small.astype(np.float32) / 255, 2, 0).copy())[None]
    with torch.inference_mode():
        logits = network_of(model).network(batch)["objectness"]
    heat = torch.sigmoid(logits)[0, 0].numpy()
    found: NDArray[np.float32] = cv2.resize(heat, (width, height), interpolation=cv2.INTER_LINEAR)
    return found
