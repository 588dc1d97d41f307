"""What a training of flow is made of: on generated pairs, or finetuned on a store's frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from tcrdata import settings
from tcrdata.errors import SettingsError
from tcrdata.learning.checkpoints import ModelIdentity
from tcrdata.learning.flow_samples import PairSettings
from tcrdata.learning.scene_pairs import SceneSettings
from tcrdata.learning.textured_planes import PlaneSettings
from tcrdata.learning.training import LoopSettings
from tcrdata.learning.training_queries import TrainingQuery, load_training_query
from tcrdata.networks.flow_losses import SELF_SUPERVISED, FlowLossSettings, KnownLossSettings
from tcrdata.networks.raft import Settings as RaftSettings
from tcrdata.plan import ROUND

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
    steps=600, batch=2, learning_rate=1.2e-5, weight_decay=1e-4, clip=1.0, average=0.99967,
    checkpoint_steps=50, threads=2,
)  # fmt: skip
"""The average keeps .8 of its teacher: what a drive lacks, as large motions, is not forgotten.
With fewer and larger steps, what is learnt depends more on the seed. Once the teacher was asked
about each pair loading is light, and leaves the threads to the steps."""


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
            del plain["pairs"]["kept_mb"]
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
    grouped = settings.grouped(assignments, ("network", "planes", "scenes", "known"))
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
    grouped = settings.grouped(assignments, ("network", "pairs", "losses", "query"))
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
