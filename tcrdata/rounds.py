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
from tcrdata.rules import Preset, load_follower, load_preset, select
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
        followers: presets that select once more after the labels of the first round, and of each
            later one, were tracked; none without tracking.
        following: overrides of their parameters, and of others.
    """

    first: Plan
    later: Plan | None = None
    rounds: int = planning.ROUND
    training: Mapping[str, str] = field(default_factory=dict)
    followers: tuple[Preset, ...] = ()
    following: Mapping[str, str] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of models that are trained: those that no setting names."""
        cues = self.later.cue_settings.items() if self.later else ()
        kinds = {planning.model_kind(cue) for cue, own in cues if not getattr(own, "model", "")}
        return tuple(sorted(kind for kind in kinds if kind))

    @property
    def units(self) -> int:
        """Number of units of work, a training counted as one."""
        followed = len(planning.TRACKING) if self.followers else 0
        own = (len(self.first.stages) + followed) * len(self.first.sequences)
        if self.later is None:
            return own
        each = (len(self.later.stages) + followed) * len(self.later.sequences) + len(self.kinds)
        return own + (self.rounds - planning.ROUND) * each

    def follower(self, number: int) -> Preset | None:
        """Return the preset that selects after a round's labels were tracked; None for none."""
        return self.followers[min(number, len(self.followers)) - 1] if self.followers else None

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
    tracking: bool = False,
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
        tracking: whether each round's labels are tracked, and decided again with what that adds.

    Raises:
        SettingsError: PyTorch is missing, an unknown name or value, or a preset without successor
            or, with tracking, without follower.
        DatasetError: the root is none of this dataset, or lacks a sequence.
    """
    values = dict(assignments or {})
    if "all" in presets:
        presets = tuple(sorted(planning.first_round_presets(), key=lambda name: name != LEADER))
    if tracking:  # those that follow select when there is something to follow
        presets = tuple(name for name in presets if not load_preset(name).follows)
    followers: tuple[Preset, ...] = (load_follower(presets[0]),) if tracking and presets else ()
    make = partial(pipeline.plan_build, dataset, root, sequences=sequences, frames=frames)
    if rounds == planning.ROUND:
        added = tuple(str(follower.file.path) for follower in followers)
        whole = make(presets=(*presets, *added), assignments=values)
        first = _with_presets(whole, presets)
        return Loop(first, followers=followers, following=whole.parameters)
    check_torch(rounds)
    training = {
        name.partition(".")[2]: values.pop(name)
        for name in list(values)
        if name.startswith(f"{_TRAIN}.")
    }
    successors = tuple(dict.fromkeys(_successor(load_preset(name)) for name in presets))
    if followers:
        followers = (*followers, load_follower(successors[0]))
    # What another preset accepts is no background to learn from: its evidence is needed, too.
    names = (*presets, *successors, *(str(follower.file.path) for follower in followers))
    whole = make(
        presets=tuple(dict.fromkeys((*names, *_others(names, values)))), assignments=values
    )
    first, later = (_part(whole, part, anew=part is successors) for part in (presets, successors))
    loop = Loop(first, later, rounds, training, followers, whole.parameters)
    for kind in loop.kinds:
        recipe_of(kind, loop.training)
    return loop


def _others(names: tuple[str, ...], values: Mapping[str, str]) -> tuple[str, ...]:
    """Names of the presets that presets name: what these accept is left undecided."""
    parameters = {name: text for name, text in values.items() if "." not in name}
    chosen = planning.loaded_presets(names, parameters)
    return tuple(other.name for preset in chosen for other in preset.others)


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
    only = loop.later is None
    make = partial(pipeline.build, workers=workers, progress=progress, newest=only)
    follow = partial(_followed, loop, store_url, workers=workers, progress=progress, newest=only)
    report = follow(make(loop.first, store_url, snapshot=snapshot), planning.ROUND, {})
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
        made = follow(make(loop.plan(number, models), store_url), number, models)
        calibrate(store, number)
        outcomes = (*report.outcomes, *learnt.values(), *made.outcomes)
        report = BuildReport(outcomes, (*report.selections, *made.selections))
    return report


def _followed(
    loop: Loop,
    store_url: str,
    made: BuildReport,
    number: int,
    models: Mapping[str, str],
    *,
    workers: int,
    progress: Progress,
    newest: bool,
) -> BuildReport:
    """Track what a round labelled; what its follower selects then leads the round.

    Correlation takes the features of the detector that the round was measured with, not of a later
    one: the same round is tracked the same way, whatever was learnt since.
    """
    from tcrdata.track_plans import plan_tracking
    from tcrdata.track_runs import track

    follower = loop.follower(number)
    if follower is None or not made.selections or not made.selections[0].labels:
        return made
    own = made.selections[0].selection_id
    tracking = plan_tracking(open_store(store_url), own, detector=models.get("detector", ""))
    outcomes = track(store_url, tracking, workers=workers, progress=progress)
    selection = select(
        open_store(store_url),
        follower,
        overrides=planning.own_parameters(follower, dict(loop.following)),
        round=number,
        leave_out_unfinished=True,
        newest=newest,
        followed=own,
    )
    return BuildReport((*made.outcomes, *outcomes), (selection, *made.selections))


def _with_presets(plan: Plan, names: tuple[str, ...]) -> Plan:
    """A plan that selects with some of its presets alone, and measures as much."""
    loaded = tuple(preset for preset in plan.loaded if preset.name in _stems(names))
    return replace(plan, presets=names, loaded=loaded)


def _part(plan: Plan, names: tuple[str, ...], *, anew: bool) -> Plan:
    """The part of a plan that is made once, or in each later round again, with its presets."""
    cues = tuple(cue for cue in plan.cues if planning.speaks_anew(cue) == anew)
    chosen = _with_presets(plan, names)
    own = {name for preset in chosen.loaded for name in preset.parameters}
    return replace(
        chosen,
        cues=cues,
        cue_settings={cue: plan.cue_settings[cue] for cue in cues},
        parameters={name: text for name, text in plan.parameters.items() if name in own},
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
