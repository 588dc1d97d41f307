"""Checkpoints: rows of `models` and `weights`, visible together or not at all."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tcrdata import settings
from tcrdata.errors import ConflictError, MissingEvidenceError, StoreError
from tcrdata.networks.trained import from_bytes, to_bytes
from tcrdata.store import Store, Unit

STAGE = "model"
ANY_DATASET = "_"
AVERAGE, STATE = "average", "state"


@dataclass(frozen=True)
class ModelIdentity:
    """All that a model follows from.

    Attributes:
        kind: detector, segmenter or flow.
        network: its module.
        labels_round: EM round of the labels.
        selection_id: of the labels.
        snapshot: the frozen list of files that is read.
        query: the select that gives the samples.
        settings: plain values of all settings.
        seed: of everything random.
    """

    kind: str
    network: str
    labels_round: int
    selection_id: str
    snapshot: str
    query: str
    settings: Mapping[str, Any]
    seed: int

    @property
    def recipe(self) -> dict[str, Any]:
        """What it follows from, the data aside."""
        return {
            "kind": self.kind,
            "network": self.network,
            "query": self.query,
            "settings": dict(self.settings),
            "seed": self.seed,
        }

    @property
    def model_id(self) -> str:
        """Hash of all of it."""
        data = [self.labels_round, self.selection_id, self.snapshot]
        return settings.digest([self.recipe, data])[:16]

    @property
    def unit(self) -> Unit:
        """The unit of work whose newest record is the newest checkpoint."""
        return Unit(STAGE, ANY_DATASET, self.model_id, self.labels_round)


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        step: steps done.
        steps: steps to do.
        losses: of each step.
        terms: mean of each part of the loss over the last tenth of the steps.
        samples: frames it learns from.
        positives: positive labels in them.
        parameters: numbers learnt.
    """

    step: int
    steps: int
    losses: tuple[float, ...]
    terms: Mapping[str, float]
    samples: int
    positives: int
    parameters: int


def save_checkpoint(
    store: Store, model: ModelIdentity, progress: Progress, parts: Mapping[str, Any]
) -> None:
    """Commit a checkpoint; a finished model keeps its averaged weights alone.

    Args:
        store: where to.
        model: what it follows from.
        progress: how far it is.
        parts: `average` and `state`, as `torch.save` takes them.

    Raises:
        ConflictError: another training has finished the model meanwhile.
    """
    finished = progress.step == progress.steps
    kept = {name: to_bytes(parts[name]) for name in ((AVERAGE,) if finished else (AVERAGE, STATE))}
    row = {
        "model_id": model.model_id,
        "kind": model.kind,
        "network": model.network,
        "labels_round": model.labels_round,
        "selection_id": model.selection_id,
        "snapshot": model.snapshot,
        "query": model.query,
        "settings": json.dumps(model.settings, sort_keys=True),
        "seed": model.seed,
        "samples": progress.samples,
        "positives": progress.positives,
        "parameters": progress.parameters,
        "step": progress.step,
        "steps": progress.steps,
        "finished": finished,
        "losses": list(progress.losses),
        "terms": sorted(progress.terms.items()),
    }
    done = settings.digest([model.model_id, progress.step])
    inputs = {"snapshot": model.snapshot, "selection": model.selection_id}
    with store.writer(model.unit, settings_hash=done, inputs=inputs) as writer:
        # What is finished from here on, the commit itself would run into.
        if not finished and is_finished(store, model):
            raise ConflictError(
                f"{store.url}: another training has finished model {model.model_id} meanwhile: "
                "it is there to use; this one ends"
            )
        writer.append("models", {name: [value] for name, value in row.items()})
        for part, data in kept.items():
            writer.append("weights", {
                "model_id": [model.model_id], "part": [part], "step": [progress.step],
                "sha256": [hashlib.sha256(data).hexdigest()], "data": [data],
            })  # fmt: skip


def is_finished(store: Store, model: ModelIdentity) -> bool:
    """Return whether a model is in a store and finished."""
    columns, sequence = ["finished"], model.unit.sequence
    rows = store.read("models", columns=columns, dataset=ANY_DATASET, sequence=sequence)
    return any(rows["finished"].to_pylist())


def model_rows(store: Store) -> list[dict[str, Any]]:
    """Return every model's row, by round, kind and id."""
    rows = store.read("models", dataset=ANY_DATASET).to_pylist()
    return sorted(rows, key=lambda row: (row["labels_round"], row["kind"], row["model_id"]))


def read_weights(store: Store, model_id: str, part: str) -> Any:
    """Return a part of a model's newest checkpoint.

    Raises:
        MissingEvidenceError: there is no such model or part.
        StoreError: the bytes are damaged.
    """
    rows = store.read("weights", dataset=ANY_DATASET, model_id=model_id, part=part).to_pylist()
    if not rows:
        raise MissingEvidenceError(
            f"{store.url}: no part '{part}' of a model '{model_id}': see `tcrdata models`"
        )
    what = f"{store.url}: model {model_id}"
    if hashlib.sha256(rows[0]["data"]).hexdigest() != rows[0]["sha256"]:
        raise StoreError(f"{what}: its weights are damaged: train again")
    return from_bytes(rows[0]["data"], what)
