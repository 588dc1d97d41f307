"""One training of flow: on generated pairs, or finetuned on a store's frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from tcrdata.errors import MissingEvidenceError
from tcrdata.evidence.flow import Settings as CueSettings
from tcrdata.evidence.flow import chosen_estimator
from tcrdata.evidence.flow_estimators import Estimator
from tcrdata.learning.checkpoints import (
    AVERAGE,
    ModelIdentity,
    Progress,
    model_rows,
    read_weights,
)
from tcrdata.learning.devices import Place, training_place
from tcrdata.learning.flow_recipes import FlowRecipe
from tcrdata.learning.flow_samples import (
    HELD_OUT,
    LEARNT,
    GeneratedPairs,
    GeneratedSamples,
    StoredPairs,
    TaughtSamples,
)
from tcrdata.learning.frames import NEEDED, Frames, open_frames
from tcrdata.learning.learner import Objective
from tcrdata.learning.stream import CountedSamples, Transform
from tcrdata.learning.taught_flows import TaughtFlows
from tcrdata.learning.training import Report, train
from tcrdata.networks.flow_losses import known_flow_losses, self_supervised_losses
from tcrdata.store import Store


def train_flow(
    store: Store,
    recipe: FlowRecipe,
    *,
    resume: bool = False,
    device: str = "auto",
    report: Callable[[Report], None] = lambda _: None,
) -> tuple[ModelIdentity, Progress | None]:
    """Train a flow network; its checkpoints land in the store.

    Returns:
        the model, and how far it is; None when it was finished before.

    Raises:
        MissingEvidenceError: there are no pairs to learn from, or nothing to resume.
        SettingsError: no such device or setting.
        TrainingError: the loss is not finite.
        StoreError: a damaged or foreign checkpoint.
        ConflictError: another training has finished the model meanwhile.
    """
    with training_place(device) as place:
        snapshot = _begun(store, recipe, place.world_size) if resume else None
        if snapshot is None:
            snapshot = "" if recipe.planes else store.freeze(None, NEEDED).name
        model = recipe.identity(snapshot, place.world_size)
        done = {row["model_id"]: row["finished"] for row in model_rows(store)}
        if done.get(model.model_id):
            return model, None
        pairs, transform, objective = _lessons(store, recipe, snapshot, place)
        begun = recipe.teacher or recipe.start
        start = read_weights(store, begun, AVERAGE) if begun else None
        progress = train(
            store, model, pairs, transform, recipe.network, recipe.loop, place,
            resume=resume and model.model_id in done, report=report, objective=objective,
            start=start, start_counts=bool(recipe.teacher),
        )  # fmt: skip
        return model, progress


def _lessons(
    store: Store, recipe: FlowRecipe, snapshot: str, place: Place
) -> tuple[CountedSamples, Transform, Objective]:
    """Return what a recipe learns from, how it is seen, and what counts.

    Raises:
        MissingEvidenceError: there are no pairs to learn from.
    """
    if recipe.planes is not None:
        return (
            GeneratedPairs(),
            GeneratedSamples(recipe.planes, recipe.scenes),
            partial(known_flow_losses, own=recipe.known),
        )
    frames = flow_frames(store, recipe, snapshot)
    pairs = StoredPairs(frames, LEARNT)
    held_out = StoredPairs(frames, HELD_OUT)
    for part, wanted in (("to learn from", pairs), ("to check with", held_out)):
        if not len(wanted):
            raise MissingEvidenceError(
                f"{store.url}: no pair of frames {part} ({frames.parameters}): a drive needs three "
                "pairs of images of one size, the last of which are held out"
            )
    loaders = max(recipe.loop.workers, 1) * place.world_size
    kept_bytes = int(recipe.pairs.kept_mb * 1e6 / loaders)
    taught = TaughtFlows(flow_teacher(store, recipe, place.device), recipe.losses, kept_bytes)
    transform = TaughtSamples(recipe.pairs, taught, recipe.losses)
    return pairs, transform, partial(self_supervised_losses, own=recipe.losses)


def flow_frames(store: Store, recipe: FlowRecipe, snapshot: str) -> Frames:
    """Return the frames of the recipe's query, as a snapshot has them."""
    return open_frames(
        store, recipe.query, snapshot=snapshot, parameters=recipe.parameters,
        lacking="pair of frames with images of one size",
    )  # fmt: skip


def flow_teacher(store: Store, recipe: FlowRecipe, device: str) -> Estimator:
    """Return the network that is finetuned, as it was, for a device that torch knows."""
    iterations = recipe.pairs.teacher_iterations
    wanted = CueSettings(method="raft", model=recipe.teacher, iterations=iterations)
    return chosen_estimator(store, wanted, threads=recipe.loop.threads, device=device)


def _begun(store: Store, recipe: FlowRecipe, processes: int) -> str:
    """Return the snapshot of the unfinished model of a recipe, or of the finished one.

    Raises:
        MissingEvidenceError: there is none.
    """
    for row in sorted(model_rows(store), key=lambda row: bool(row["finished"])):
        if recipe.identity(row["snapshot"], processes).model_id == row["model_id"]:
            return str(row["snapshot"])
    raise MissingEvidenceError(
        f"{store.url}: no checkpoint of a flow network with these settings to resume: see "
        "`tcrdata models`, or leave --resume out"
    )
