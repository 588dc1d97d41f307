"""Measures a finetuned flow network and its teacher on pairs that neither learnt from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tcrdata import __version__
from tcrdata.errors import MissingEvidenceError
from tcrdata.evidence.flow import Settings as CueSettings
from tcrdata.evidence.flow import chosen_estimator
from tcrdata.evidence.flow_quality import flow_quality
from tcrdata.learning.checkpoints import ANY_DATASET, ModelIdentity
from tcrdata.learning.devices import device_named
from tcrdata.learning.flow_recipes import FlowRecipe
from tcrdata.learning.flow_runs import flow_frames
from tcrdata.learning.flow_samples import HELD_OUT, StoredPairs
from tcrdata.plan import ROUND
from tcrdata.store import Store, Unit

STAGE = "flow_check"


def check_flow(
    store: Store,
    recipe: FlowRecipe,
    model: ModelIdentity,
    checked: Callable[[int, int], object] = lambda *_: None,
    device: str = "auto",
) -> bool:
    """Write a finished student's rows of `flow_checks`, unless they are there.

    Args:
        store: holds student and teacher.
        recipe: of the student.
        model: the student.
        checked: called after each pair: how many are done, of how many.
        device: auto, cpu or cuda.

    Returns:
        Whether anything was written.

    Raises:
        MissingEvidenceError: no pair is held out.
        FrameError: an image cannot be read.
    """
    unit = Unit(STAGE, ANY_DATASET, model.model_id, ROUND)
    inputs = {"model": model.model_id, "snapshot": model.snapshot}
    if store.is_done(unit, __version__, inputs):
        return False
    pairs = StoredPairs(flow_frames(store, recipe, model.snapshot), HELD_OUT)
    if not len(pairs):
        raise MissingEvidenceError(f"{store.url}: no pair of frames is held out to check with")
    threads, place = recipe.loop.threads, device_named(device)
    networks = {
        role: (name, chosen_estimator(store, CueSettings("raft", name), 1, threads, place))
        for role, name in (("student", model.model_id), ("teacher", recipe.teacher))
    }
    rows: list[dict[str, Any]] = []
    for number in range(len(pairs)):
        pair = pairs[number]
        keys = {name: pair[name] for name in ("dataset", "sequence", "frame", "frame_to")}
        for role, (name, estimator) in networks.items():
            flows = estimator.both_ways(pair["first"], pair["second"])
            quality = flow_quality(pair["first"], pair["second"], *flows)._asdict()
            own = {"model_id": model.model_id, "role": role, "measured_id": name}
            rows.append({**own, **keys, **quality})
        checked(number + 1, len(pairs))
    with store.writer(unit, settings_hash=__version__, inputs=inputs) as writer:
        writer.append("flow_checks", {name: [row[name] for row in rows] for name in rows[0]})
    return True
