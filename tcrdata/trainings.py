"""The M step: which models a round learns, how, and from the labels of which selection."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.errors import ConflictError, SettingsError
from tcrdata.outcomes import UnitOutcome
from tcrdata.plan import ROUND
from tcrdata.rules import Selection, load_preset, preset_names
from tcrdata.store import Store, Unit

if TYPE_CHECKING:
    from tcrdata.learning.runs import Recipe
    from tcrdata.learning.training import Report

SEES_IMAGES = frozenset({"segmenter"})
"""Kinds of models that learn from images."""

Trained = Callable[[int, str, "Report"], None]
"""Called after each step of a training: round of the labels, kind of the model, how far it is."""


def recipe_of(kind: str, assignments: Mapping[str, str]) -> Recipe:
    """Return how a kind of model is trained.

    Args:
        kind: detector or segmenter.
        assignments: `name=value` for every kind, `detector.name=value` for that one alone.

    Raises:
        SettingsError: an unknown name or value.
    """
    from tcrdata.learning.runs import LOOPS, plan_recipe

    own: dict[str, str] = {}
    for name, text in assignments.items():
        first, _, rest = name.partition(".")
        if first in LOOPS:
            own |= {rest: text} if first == kind else {}
        elif name not in own:
            own[name] = text
    return plan_recipe(kind, own)


def learnable(store: Store, kinds: Sequence[str]) -> list[str]:
    """Return those kinds that a store holds anything to learn from for: images for a segmenter."""
    if not SEES_IMAGES.intersection(kinds):
        return list(kinds)
    images = store.read("frames", columns=["has_image"], round=ROUND)["has_image"]
    return [kind for kind in kinds if kind not in SEES_IMAGES or any(images.to_pylist())]


def unheard_presets(store: Store, selection_id: str) -> list[str]:
    """Return presets whose labels a selection should have left undecided, had they been measured.

    Args:
        store: that holds it.
        selection_id: of labels to learn from; none where its preset is not one that ships.
    """
    columns = ["preset", "alternatives"]
    rows = store.read("selections", columns=columns, selection_id=selection_id).to_pylist()
    names = [row["preset"] for row in rows if row["preset"] in preset_names()]
    heard = {other["name"] for row in rows for other in json.loads(row["alternatives"] or "[]")}
    wanted = [other.name for name in names for other in load_preset(name).others]
    return [name for name in wanted if name not in heard]


def known_model(store: Store, recipe: Recipe, selection_id: str) -> dict[str, Any] | None:
    """Return the row of the model of a recipe and labels, finished before begun ones; None if none.

    Args:
        store: that holds it.
        recipe: all but the data.
        selection_id: of the labels.
    """
    from tcrdata.learning.checkpoints import model_rows

    rows = [row for row in model_rows(store) if row["selection_id"] == selection_id]
    data = ("selection_id", "labels_round", "snapshot")
    own = [r for r in rows if r["model_id"] == recipe.identity(*(r[n] for n in data)).model_id]
    return max(own, key=lambda row: (row["finished"], row["step"]), default=None)


def learn(store: Store, recipe: Recipe, labels: Selection, trained: Trained) -> UnitOutcome:
    """Train on a selection, from the last checkpoint where there is one.

    Args:
        store: holds the labels, gets the model.
        recipe: of the model.
        labels: what to learn from.
        trained: called after each step.

    Raises:
        MissingEvidenceError: there are no positive labels.
        TrainingError: the training goes astray.
    """
    from tcrdata.learning.checkpoints import is_finished
    from tcrdata.learning.frames import freeze_training_tables
    from tcrdata.learning.runs import run_training

    row = known_model(store, recipe, labels.selection_id)
    snapshot = row["snapshot"] if row else freeze_training_tables(store)
    model = recipe.identity(labels.selection_id, labels.round, snapshot)
    unit = Unit(model.unit.stage, model.unit.dataset, model.model_id, labels.round)
    try:
        _, made = run_training(
            store,
            recipe,
            selection_id=labels.selection_id,
            snapshot=snapshot,
            resume=row is not None and not row["finished"],
            report=lambda report: trained(labels.round, recipe.kind, report),
        )
    except ConflictError:
        # Of two builds at once the slower one goes on with what the other has made.
        if not is_finished(store, model):
            raise
        made = None
    return UnitOutcome(unit, "made" if made else "done")


def check_torch(rounds: int) -> None:
    """Refuse to plan trainings that could not be run.

    Raises:
        SettingsError: PyTorch is not installed; names the extra that brings it.
    """
    if importlib.util.find_spec("torch") is None:
        raise SettingsError(
            f"--rounds {rounds} trains networks, which takes PyTorch: "
            "pip install 'tcrdata[train]', or build one round"
        )
