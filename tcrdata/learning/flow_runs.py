"""One training of flow: on generated pairs, or finetuned on a store's frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from tcrdata import settings
from tcrdata.errors import MissingEvidenceError, SettingsError
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
from tcrdata.learning.devices import training_place
from tcrdata.learning.flow_samples import (
    LEARNT,
    GeneratedPairs,
    GeneratedSamples,
    PairSettings,
    StoredPairs,
    TaughtSamples,
)
from tcrdata.learning.frames import NEEDED, Frames, open_frames
from tcrdata.learning.learner import Objective
from tcrdata.learning.scene_pairs import SceneSettings
from tcrdata.learning.stream import CountedSamples, Transform
from tcrdata.learning.textured_planes import PlaneSettings
from tcrdata.learning.training import LoopSettings, Report, train
from tcrdata.learning.training_queries import TrainingQuery, load_training_query
from tcrdata.networks.flow_losses import (
    SELF_SUPERVISED,
    FlowLossSettings,
    KnownLossSettings,
    known_flow_losses,
    self_supervised_losses,
)
from tcrdata.networks.raft import Settings as RaftSettings
from tcrdata.plan import ROUND
from tcrdata.store import Store

KIND, NETWORK = "flow", "raft"
SCRATCH_LOOP = LoopSettings(
    steps=1500, batch=1, learning_rate=4e-4, weight_decay=1e-4, clip=1.0, average=0.995
)
LARGER_LOOP = replace(SCRATCH_LOOP, steps=800, learning_rate=2e-4)
"""Small pairs are cheap, but their coarsest correlations are hardly any: large ones teach those."""

LARGER_PLANES = PlaneSettings(height_px=256, width_px=320, shift_px=4.0, still=0.3, plain=0.4)
LARGER_SCENES = SceneSettings(share=0.5)
"""Before a camera that stands hardly a pixel moves, and by nothing: that planes do not teach."""

LARGER_ITERATIONS = 6
TAUGHT_LOOP = LoopSettings(
    steps=200, batch=2, learning_rate=3.5e-5, weight_decay=1e-4, clip=1.0, average=0.999,
    checkpoint_steps=25,
)  # fmt: skip
"""The average keeps .8 of its teacher: what a drive lacks, as large motions, is not forgotten.
With half as many steps, twice as large, what is learnt depends more on the seed."""


@dataclass(frozen=True)
class FlowRecipe:
    """Everything about a training of flow but its frames.

    Attributes:
        network: of RAFT.
        loop: of the loop.
        planes: generated pairs; None when finetuned.
        scenes: generated pairs that show a scene instead.
        pairs: what is cut of a store's pairs.
        losses: what counts of a store's pairs.
        known: what counts of generated ones.
        query: what a pair is.
        parameters: of the query, name to text.
        teacher: id of the model that is finetuned; empty on generated pairs.
        start: id of the model that goes on learning from generated pairs; empty from scratch.
    """

    network: RaftSettings
    loop: LoopSettings
    planes: PlaneSettings | None
    scenes: SceneSettings = field(default_factory=SceneSettings)
    pairs: PairSettings = field(default_factory=PairSettings)
    losses: FlowLossSettings = field(default_factory=FlowLossSettings)
    known: KnownLossSettings = field(default_factory=KnownLossSettings)
    query: TrainingQuery = field(default_factory=lambda: load_training_query("flow"))
    parameters: Mapping[str, str] = field(default_factory=dict)
    teacher: str = ""
    start: str = ""

    def identity(self, snapshot: str, processes: int = 1) -> ModelIdentity:
        """Return what the model follows from.

        Args:
            snapshot: the frozen list of files that is read; empty from scratch.
            processes: that learn together: each takes a batch a step.
        """
        plain: dict[str, Any] = {
            "network": settings.as_plain(self.network),
            "loop": settings.as_plain(self.loop),
        }
        # Where and how often it is loaded and saved leaves the numbers as they are.
        for name in ("workers", "checkpoint_steps"):
            del plain["loop"][name]
        if processes > 1:
            plain["loop"]["processes"] = processes
        if self.planes is not None:
            plain |= {"planes": settings.as_plain(self.planes)}
            plain |= {"known": settings.as_plain(self.known)}
            # Scenes that are never drawn leave the numbers as they are.
            if self.scenes.share > 0:
                plain |= {"scenes": settings.as_plain(self.scenes)}
            plain |= {"start": self.start} if self.start else {}
        else:
            plain |= {
                "pairs": settings.as_plain(self.pairs),
                "losses": settings.as_plain(self.losses),
                "query": dict(sorted(self.parameters.items())),
                "teacher": self.teacher,
            }
        text = "" if self.planes is not None else self.query.text
        return ModelIdentity(KIND, NETWORK, ROUND, "", snapshot, text, plain, self.loop.seed)


def plan_on_generated(
    size: str | None, assignments: Mapping[str, str], start: Mapping[str, Any] | None = None
) -> FlowRecipe:
    """Return the recipe of a network that learns from generated pairs.

    Args:
        size: small or full; of a network from scratch.
        assignments: of the loop (`steps`), `network.iterations`, `planes.shift_px`,
            `scenes.share` or `known.matching`.
        start: the row of `models` of the network that goes on learning, on larger pairs; None from
            scratch.

    Raises:
        SettingsError: an unknown name or value.
    """
    grouped = _grouped(assignments, ("network", "planes", "scenes", "known"))
    if start is None:
        network = RaftSettings(size or "small", iterations=4)
        loop, planes, known = SCRATCH_LOOP, PlaneSettings(), KnownLossSettings()
        scenes = SceneSettings()
    else:
        network = RaftSettings(start["settings"]["network"]["size"], LARGER_ITERATIONS)
        loop, planes, known = LARGER_LOOP, LARGER_PLANES, KnownLossSettings(matching=1.0)
        scenes = LARGER_SCENES
    return FlowRecipe(
        settings.overridden(network, grouped["network"], "network"),
        settings.overridden(loop, grouped[""], "train"),
        settings.overridden(planes, grouped["planes"], "planes"),
        settings.overridden(scenes, grouped["scenes"], "scenes"),
        known=settings.overridden(known, grouped["known"], "known"),
        start=str(start["model_id"]) if start else "",
    )


def plan_finetuning(
    teacher: Mapping[str, Any], losses: tuple[str, ...] | None, assignments: Mapping[str, str]
) -> FlowRecipe:
    """Return the recipe of a student of a teacher.

    Args:
        teacher: the row of `models` of the network to finetune: `model_id` and `settings`.
        losses: which of photometric, teacher and occlusion; None for all.
        assignments: of the loop, `network.iterations`, `pairs.height_px`, `losses.teacher` or
            `query.held_out_share`.

    Raises:
        SettingsError: an unknown name or value, or no loss.
    """
    grouped = _grouped(assignments, ("network", "pairs", "losses", "query"))
    chosen = SELF_SUPERVISED if losses is None else losses
    for name in chosen:
        if name not in SELF_SUPERVISED:
            raise SettingsError(settings.unknown(f"loss '{name}'", name, SELF_SUPERVISED))
    left_out = {name: "0" for name in SELF_SUPERVISED if name not in chosen}
    # What is asked for by name has no help of the others, unless that is asked for too.
    weights = {**({"unseen": "0"} if left_out else {}), **grouped["losses"], **left_out}
    size = teacher["settings"]["network"]["size"]
    network = RaftSettings(size, iterations=4, frozen_norms=True, both_ways=True)
    return FlowRecipe(
        settings.overridden(network, grouped["network"], "network"),
        settings.overridden(TAUGHT_LOOP, grouped[""], "train"),
        None,
        pairs=settings.overridden(PairSettings(), grouped["pairs"], "pairs"),
        losses=settings.overridden(FlowLossSettings(), weights, "losses"),
        parameters=grouped["query"],
        teacher=str(teacher["model_id"]),
    )


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
    """
    with training_place(device) as place:
        snapshot = _begun(store, recipe, place.world_size) if resume else None
        if snapshot is None:
            snapshot = "" if recipe.planes else store.freeze(None, NEEDED).name
        model = recipe.identity(snapshot, place.world_size)
        done = {row["model_id"]: row["finished"] for row in model_rows(store)}
        if done.get(model.model_id):
            return model, None
        pairs, transform, objective = _lessons(store, recipe, snapshot)
        begun = recipe.teacher or recipe.start
        start = read_weights(store, begun, AVERAGE) if begun else None
        progress = train(
            store, model, pairs, transform, recipe.network, recipe.loop, place,
            resume=resume and model.model_id in done, report=report, objective=objective,
            start=start, start_counts=bool(recipe.teacher),
        )  # fmt: skip
        return model, progress


def _lessons(
    store: Store, recipe: FlowRecipe, snapshot: str
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
    pairs = StoredPairs(flow_frames(store, recipe, snapshot), LEARNT)
    if not len(pairs):
        raise MissingEvidenceError(
            f"{store.url}: no pair of frames to learn from: a drive needs three pairs of "
            "images, the last of which are held out"
        )
    transform = TaughtSamples(recipe.pairs, flow_teacher(store, recipe), recipe.losses)
    return pairs, transform, partial(self_supervised_losses, own=recipe.losses)


def flow_frames(store: Store, recipe: FlowRecipe, snapshot: str) -> Frames:
    """Return the frames of the recipe's query, as a snapshot has them."""
    return open_frames(store, recipe.query, snapshot=snapshot, parameters=recipe.parameters)


def flow_teacher(store: Store, recipe: FlowRecipe) -> Estimator:
    """Return the network that is finetuned, as it was."""
    iterations = recipe.pairs.teacher_iterations
    wanted = CueSettings(method="raft", model=recipe.teacher, iterations=iterations)
    return chosen_estimator(store, wanted)


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


def _grouped(assignments: Mapping[str, str], groups: tuple[str, ...]) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {name: {} for name in ("", *groups)}
    for name, text in assignments.items():
        group, dot, attribute = name.partition(".")
        if dot and group not in groups:
            raise SettingsError(settings.unknown(f"group '{group}' in '{name}'", group, groups))
        found[group if dot else ""][attribute if dot else name] = text
    return found
