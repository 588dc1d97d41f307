"""What a build will do: stages in order, their settings and their inputs, before any work."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tcrdata import __version__, registry, settings
from tcrdata.errors import DatasetError, SettingsError
from tcrdata.frame_ranges import FrameRanges
from tcrdata.store import Store, Unit
from tcrdata.store.followed import BOXES
from tcrdata.types import Dataset

if TYPE_CHECKING:
    from tcrdata.rules import Preset

FRAMES = "frames"
TRUTH = "ground_truth"
ROUND = 1
TRACKING = ("tracklets", "tracklets_library", BOXES)
"""Units of a sequence whose labels are tracked: short range, with the library, boxes added."""


@dataclass(frozen=True)
class Plan:
    """One build, fixed before it starts; small and picklable.

    Attributes:
        dataset: name or dotted path of the dataset adapter.
        root: where the dataset lies (a spec for generated ones).
        sequences: what is built, in order.
        frames: which frames of each sequence.
        presets: names of the presets to select with.
        cues: stages in an order in which each comes after those it needs.
        cue_settings: frozen settings, one a cue.
        parameters: overrides of rule parameters, name to SQL literal.
        loaded: the presets, read when the build was planned.
        round: EM round; later ones than the first only measure with what was trained.
    """

    dataset: str
    root: str
    sequences: tuple[str, ...]
    frames: FrameRanges
    presets: tuple[str, ...]
    cues: tuple[str, ...]
    cue_settings: dict[str, Any] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    loaded: tuple[Preset, ...] = field(default=(), repr=False)
    round: int = ROUND

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages of one sequence, in order."""
        return (FRAMES, TRUTH, *self.cues) if self.round == ROUND else self.cues

    def units(self, sequence: str) -> list[Unit]:
        """The units of work of one sequence, in order."""
        return [Unit(stage, self.dataset_name, sequence, self.round) for stage in self.stages]

    @property
    def dataset_name(self) -> str:
        """The last part of the dataset's dotted path: the value of the column `dataset`."""
        return self.dataset.rpartition(".")[2]

    def settings_hash(self, stage: str) -> str:
        """Hash of what, besides its inputs, a stage's rows follow from: settings and version."""
        plain = settings.as_plain(self.cue_settings.get(stage))
        return settings.digest({"version": __version__, "stage": stage, "settings": plain})

    def as_plain(self) -> dict[str, Any]:
        """The plan as plain values for the table `runs`."""
        return {
            "dataset": self.dataset_name,
            "root": self.root,
            "sequences": list(self.sequences),
            "frames": self.frames.text,
            "presets": list(self.presets),
            "round": self.round,
            "stages": list(self.stages),
            "settings": {cue: settings.as_plain(self.cue_settings[cue]) for cue in self.cues},
            "parameters": dict(sorted(self.parameters.items())),
        }

    @property
    def run_id(self) -> str:
        """Identity of the build: the same plan and version, the same id."""
        return settings.digest({"version": __version__, **self.as_plain()})[:16]


def chosen_sequences(dataset: Dataset, wanted: tuple[str, ...] | None) -> tuple[str, ...]:
    """Return the sequences that are wanted, in the dataset's order; all for None.

    Raises:
        DatasetError: the dataset lacks one, or none is wanted.
    """
    available = dataset.sequences()
    known = ", ".join(available[:8])
    known += f" and {len(available) - 8} more" if len(available) > 8 else ""
    if wanted == ():
        raise DatasetError(f"no sequence named; there are {known}")
    if missing := sorted(set(wanted or ()) - set(available)):
        raise DatasetError(f"{dataset.root}: no sequence {', '.join(missing)}; there are {known}")
    return tuple(name for name in available if wanted is None or name in wanted)


def loaded_presets(names: Iterable[str], parameters: dict[str, str]) -> list[Preset]:
    """Return presets; refuses what their selections would refuse after all the measuring.

    Args:
        names: of presets, or paths.
        parameters: overrides; each must belong to one of the presets at least.

    Raises:
        SettingsError: no preset, an unknown one, an unknown parameter or a value of another type.
        RuleError: a file is wrong.
    """
    # What is planned without presets waits for no rules.
    from tcrdata.rules import load_preset, preset_names

    presets = [load_preset(name) for name in names]
    if not presets:
        raise SettingsError(f"no preset named: there are {', '.join(preset_names())}, all")
    known = {parameter for preset in presets for parameter in preset.parameters}
    for name in parameters:
        if name not in known:
            raise SettingsError(settings.unknown(f"parameter '{name}'", name, known))
    for preset in presets:
        preset.fill(own_parameters(preset, parameters))
    return presets


def first_round_presets() -> tuple[str, ...]:
    """Return the presets that ship with tcrdata and read no cue that needs a trained model."""
    from tcrdata.rules import load_preset, preset_names

    return tuple(
        name for name in preset_names() if not any(map(speaks_anew, load_preset(name).cues))
    )


def model_kind(cue: str) -> str | None:
    """Return the kind of trained model that a cue measures with; None when it needs none."""
    return getattr(registry.find("evidence", cue), "NEEDS_MODEL", None)


def speaks_anew(stage: str) -> bool:
    """Whether a stage is measured in every later round again: with a model, or from one's words."""
    if stage in (FRAMES, TRUTH):
        return False
    return bool(model_kind(stage)) or any(map(speaks_anew, needed_stages(stage)))


def own_parameters(preset: Preset, parameters: dict[str, str]) -> dict[str, str]:
    """Return those overrides that a preset has: with several presets each takes its own."""
    return {name: text for name, text in parameters.items() if name in preset.parameters}


def ordered_cues(wanted: Iterable[str]) -> tuple[str, ...]:
    """Return the cues and all that they need, each after what it needs.

    Raises:
        SettingsError: an unknown cue, or cues that need one another in a circle.
    """
    order: list[str] = []
    path: list[str] = []

    def visit(cue: str) -> None:
        if cue in order:
            return
        if cue in path:
            raise SettingsError(f"cues need one another in a circle: {' -> '.join([*path, cue])}")
        path.append(cue)
        for needed in registry.find("evidence", cue).NEEDS:
            visit(needed)
        path.pop()
        order.append(cue)

    for cue in sorted(wanted):
        visit(cue)
    return tuple(order)


def cue_settings(cues: Iterable[str], assignments: dict[str, str]) -> dict[str, Any]:
    """Return each cue's settings with `cue.field=value` assignments applied.

    Raises:
        SettingsError: an assignment to a cue that is not built, an unknown field, a wrong type.
    """
    cues = tuple(cues)
    values: dict[str, dict[str, str]] = {cue: {} for cue in cues}
    for name, text in assignments.items():
        cue, _, attribute = name.partition(".")
        if cue not in values:
            raise SettingsError(settings.unknown(f"cue '{cue}' in '{name}={text}'", cue, cues))
        values[cue][attribute] = text
    return {
        cue: settings.overridden(registry.find("evidence", cue).Settings(), values[cue], cue)
        for cue in cues
    }


def needed_stages(stage: str) -> tuple[str, ...]:
    """Return the stages whose rows a stage reads."""
    if stage in (FRAMES, TRUTH):
        return ()
    return (FRAMES, *registry.find("evidence", stage).NEEDS)


def cue_inputs(store: Store, unit: Unit) -> dict[str, str]:
    """Return the digests of the records that a unit reads."""
    inputs: dict[str, str] = {}
    for stage in needed_stages(unit.stage):
        number = unit.round if speaks_anew(stage) else ROUND
        record = store.record(Unit(stage, unit.dataset, unit.sequence, number))
        inputs[stage] = record.digest if record else "missing"
    return inputs


def record_run(store: Store, plan: Plan) -> None:
    """Write the plan as a row of `runs`, unless this store has it already."""
    unit = Unit("run", "_", plan.run_id, plan.round)
    row = {
        "run_id": [plan.run_id],
        "command": ["build"],
        "version": [__version__],
        "settings": [json.dumps(plan.as_plain(), sort_keys=True)],
        "packages": [sorted(package_versions().items())],
        "units": [sum(len(plan.units(sequence)) for sequence in plan.sequences)],
    }
    content = settings.digest({name: str(values) for name, values in row.items()})
    if store.is_done(unit, content, {}):
        return
    with store.writer(unit, settings_hash=content, inputs={}) as writer:
        writer.append("runs", row)


def package_versions() -> dict[str, str]:
    """Return the versions of the installed packages whose numbers end up in rows."""
    from importlib.metadata import PackageNotFoundError, version

    found: dict[str, str] = {}
    for package in (
        "duckdb", "kiss-icp", "numba", "numpy", "opencv-python-headless", "pyarrow",
        "pypatchworkpp", "scikit-learn", "scipy", "shapely", "small-gicp", "torch",
    ):  # fmt: skip
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found
