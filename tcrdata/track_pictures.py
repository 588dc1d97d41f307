"""Pictures of how tracking went: overlap over time, and a timeline of each sequence's objects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tcrdata.errors import SettingsError
from tcrdata.evaluation.series import TRUTH, SequenceSeries, overlap
from tcrdata.evaluation.tracking_metrics import STARTED, read_sequences
from tcrdata.evaluation.tracking_scores import TrackingEvaluation
from tcrdata.store import Store
from tcrdata.views.canvas import png_bytes
from tcrdata.views.tracking_picture import Lane, Line, overlap_picture, timeline_picture

_MOST_SEQUENCES = 20


def draw_tracking(
    store: Store, selection_id: str, evaluation: TrackingEvaluation, out: str
) -> Iterator[Path]:
    """Draw what `evaluate tracking` scored; yields each file once it is there.

    Args:
        store: as evaluated.
        selection_id: whose labels.
        evaluation: its result.
        out: folder, made when absent: `overlap.png`, and `timeline_<sequence>.png` for the first
            20 sequences.

    Raises:
        SettingsError: the folder cannot be made.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"--out {out}: {error.strerror}: give another folder") from error
    lines = [
        Line(
            f"library {'on' if curve.kind.endswith('library') else 'off'}, {curve.subset}",
            np.array([np.nan if value is None else value for value in curve.iou]),
        )
        for curve in evaluation.curves
    ]
    if lines:
        path = folder / "overlap.png"
        path.write_bytes(png_bytes(overlap_picture(lines)))
        yield path
    for number, sequence in enumerate(read_sequences(store, selection_id)):
        if number == _MOST_SEQUENCES:
            break
        kind = next((kind for kind in reversed(STARTED) if sequence.of(kind)), None)
        if kind is None:
            continue
        path = folder / f"timeline_{sequence.sequence}.png"
        title = f"{sequence.dataset} {sequence.sequence}: tracked from true first boxes"
        path.write_bytes(png_bytes(timeline_picture(title, lanes_of(sequence, kind))))
        yield path


def lanes_of(sequence: SequenceSeries, kind: str) -> list[Lane]:
    """Return a lane for every labelled object of a sequence, with the tracklet that began on it."""
    own = {tracklet.object_id: tracklet for tracklet in sequence.of(kind)}
    lanes = []
    for truth in sequence.of(TRUTH):
        tracklet = own.get(truth.name)
        frames = np.empty(0, dtype=np.int64) if tracklet is None else tracklet.frames
        lanes.append(
            Lane(
                truth.name,
                truth.frames,
                ~truth.scored,
                frames,
                () if tracklet is None else tuple(str(found) for found in tracklet.found),
                np.array([overlap(tracklet, truth, int(f)) for f in frames] if tracklet else []),
            )
        )
    return lanes
