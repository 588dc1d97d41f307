"""The EM loop: measure and select; learn from the labels; measure with what was learnt; repeat.

Each round's evidence, labels and models stay in the store beside those of the others. A loop that
was stopped goes on where it was: in the middle of a training, at its last checkpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from tcrdata import pipeline
from tcrdata import plan as planning
from tcrdata.calibration import calibrate
from tcrdata.errors import SettingsError
from tcrdata.frame_ranges import FrameRanges
from tcrdata.outcomes import BuildReport
from tcrdata.pipeline import Progress
from tcrdata.plan import Plan
from tcrdata.rules import Preset, load_preset
from tcrdata.store import open_store
from tcrdata.trainings import Trained, check_torch, learn, learnable, recipe_of

LEADER = "tcrdata"
"""Of all presets together, the one whose labels are learnt from."""

_TRAIN = "train"


@dataclass(frozen=True)
class Loop:
    """All rounds of a build, fixed before it starts.

    Attributes:
        first: what the first round makes, with all that later ones read of it.
        later: what each later round makes, None without one; with which models comes to be known.
        rounds: how many.
        training: `name=value` of the trainings; `detector.name` is for that kind alone.
    """

    first: Plan
    later: Plan | None = None
    rounds: int = planning.ROUND
    training: Mapping[str, str] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of models that are trained: those that no setting names."""
        cues = self.later.cue_settings.items() if self.later else ()
        kinds = {planning.model_kind(cue) for cue, own in cues if not getattr(own, "model", "")}
        return tuple(sorted(kind for kind in kinds if kind))

    @property
    def units(self) -> int:
        """Number of units of work, a training counted as one."""
        own = len(self.first.stages) * len(self.first.sequences)
        if self.later is None:
            return own
        each = len(self.later.stages) * len(self.later.sequences) + len(self.kinds)
        return own + (self.rounds - planning.ROUND) * each

    def plan(self, number: int, models: Mapping[str, str]) -> Plan:
        """Return the plan of a round.

        Args:
            number: of the round.
            models: kind to the id of the model that the round measures with.
        """
        if number == planning.ROUND or self.later is None:
            return self.first
        own = {
            cue: _with_model(cue, settings, models)
            for cue, settings in self.later.cue_settings.items()
        }
        return replace(self.later, round=number, cue_settings=own)


def plan_rounds(
    dataset: str,
    root: str,
    *,
    rounds: int,
    sequences: tuple[str, ...] | None = None,
    frames: FrameRanges | None = None,
    presets: tuple[str, ...] = ("tcrdata",),
    assignments: Mapping[str, str] | None = None,
) -> Loop:
    """Return the plan of a build.

    Args:
        dataset: name or dotted path of a dataset adapter.
        root: where it lies.
        rounds: how many.
        sequences: which ones; None for all.
        frames: which frames of each; None for all.
        presets: of the first round; the models learn from the labels of the first one named.
        assignments: as in `plan_build`, and `train.name=value` for the trainings.

    Raises:
        SettingsError: PyTorch is missing, an unknown name or value, or a preset without successor.
        DatasetError: the root is none of this dataset, or lacks a sequence.
    """
    values = dict(assignments or {})
    if rounds == planning.ROUND:
        return Loop(
            pipeline.plan_build(
                dataset, root, sequences=sequences, frames=frames, presets=presets,
                assignments=values,
            )
        )  # fmt: skip
    check_torch(rounds)
    training = {
        name.partition(".")[2]: values.pop(name)
        for name in list(values)
        if name.startswith(f"{_TRAIN}.")
    }
    names, successors, others = _presets_of_rounds(presets, values)
    # What another preset accepts is no background to learn from: its evidence is needed, too.
    whole = pipeline.plan_build(
        dataset, root, sequences=sequences, frames=frames, assignments=values,
        presets=tuple(dict.fromkeys((*names, *successors, *others))),
    )  # fmt: skip
    first, later = (_part(whole, part, anew=part is successors) for part in (names, successors))
    loop = Loop(first, later, rounds, training)
    for kind in loop.kinds:
        recipe_of(kind, loop.training)
    return loop


def _presets_of_rounds(
    presets: tuple[str, ...], values: Mapping[str, str]
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Names of the presets of the first round, of the later ones, and of those that they name."""
    names = presets
    if "all" in presets:
        names = tuple(sorted(planning.first_round_presets(), key=lambda name: name != LEADER))
    successors = tuple(dict.fromkeys(_successor(load_preset(name)) for name in names))
    parameters = {name: text for name, text in values.items() if "." not in name}
    chosen = planning.loaded_presets((*names, *successors), parameters)
    return names, successors, tuple(other.name for preset in chosen for other in preset.others)


def build_rounds(
    loop: Loop,
    store_url: str,
    *,
    workers: int,
    progress: Progress,
    trained: Trained,
    snapshot: str | None = None,
) -> BuildReport:
    """Run the loop: what is missing of each round is made, what is done is left as it is.

    Args:
        loop: what to build.
        store_url: where; created when absent.
        workers: worker processes.
        progress: called with each unit's outcome as it is known.
        trained: called after each step of a training.
        snapshot: of a single round, the evidence that is judged; see `pipeline.build`.

    Raises:
        TcrdataError: the store cannot be written, a round gives no labels to learn from, or a
            training goes astray.
    """
    if loop.later is None:
        return pipeline.build(
            loop.first, store_url, workers=workers, progress=progress, snapshot=snapshot
        )
    make = partial(pipeline.build, workers=workers, progress=progress, newest=False)
    report = make(loop.first, store_url)
    store = open_store(store_url)
    for number in range(planning.ROUND + 1, loop.rounds + 1):
        if len(report.leading) < number - planning.ROUND:
            break
        learnt = {}
        for kind in learnable(store, loop.kinds):
            recipe = recipe_of(kind, loop.training)
            learnt[kind] = learn(store, recipe, report.leading[-1], trained)
            progress(learnt[kind])
        models = {kind: outcome.unit.sequence for kind, outcome in learnt.items()}
        made = make(loop.plan(number, models), store_url)
        calibrate(store, number)
        outcomes = (*report.outcomes, *learnt.values(), *made.outcomes)
        report = BuildReport(outcomes, (*report.selections, *made.selections))
    return report


def _part(plan: Plan, names: tuple[str, ...], *, anew: bool) -> Plan:
    """The part of a plan that is made once, or in each later round again, with its presets."""
    cues = tuple(cue for cue in plan.cues if planning.speaks_anew(cue) == anew)
    loaded = tuple(preset for preset in plan.loaded if preset.name in _stems(names))
    own = {name for preset in loaded for name in preset.parameters}
    return replace(
        plan,
        presets=names,
        cues=cues,
        cue_settings={cue: plan.cue_settings[cue] for cue in cues},
        parameters={name: text for name, text in plan.parameters.items() if name in own},
        loaded=loaded,
        round=planning.ROUND + anew,
    )


def _stems(names: tuple[str, ...]) -> set[str]:
    """Names of presets that may be given as paths."""
    return {name.rpartition("/")[2].removesuffix(".sql") for name in names}


def _successor(preset: Preset) -> str:
    """Name of the preset that selects in the rounds after a preset's."""
    if learnt := [cue for cue in preset.cues if planning.speaks_anew(cue)]:
        raise SettingsError(
            f"preset {preset.name} reads {learnt[0]}, which takes a model: the first round has "
            "none; begin with a preset that names this one in a line `-- next:` of its header"
        )
    if preset.successor == preset.name:
        raise SettingsError(
            f"preset {preset.name} reads nothing that is learnt, so that later rounds would repeat "
            "its labels: name a preset for them in a line `-- next:` of its header, or build one "
            "round"
        )
    return preset.successor


def _with_model(cue: str, settings: Any, models: Mapping[str, str]) -> Any:
    """A cue's settings with the model of its kind, unless they name one already."""
    kind = planning.model_kind(cue)
    if kind is None or kind not in models or settings.model:
        return settings
    return replace(settings, model=models[kind])
