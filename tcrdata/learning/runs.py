"""One training from what the user asked for: labels, snapshot, settings, a resumed run or a new."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tcrdata import registry, settings
from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.learning.augmentation import ImageAugmentation, SweepAugmentation
from tcrdata.learning.checkpoints import ModelIdentity, Progress, model_rows
from tcrdata.learning.detector_samples import DetectorSamples
from tcrdata.learning.devices import Place, training_place
from tcrdata.learning.frames import freeze_training_tables, open_frames
from tcrdata.learning.segmenter_samples import SegmenterSamples
from tcrdata.learning.training import LoopSettings, Report, train
from tcrdata.learning.training_queries import TrainingQuery, load_training_query
from tcrdata.networks.center_targets import TargetSettings
from tcrdata.store import Store

NETWORKS = {"detector": "birds_eye", "segmenter": "pyramid"}
"""The network of each kind, unless the settings name another."""

LOOPS = {
    "detector": LoopSettings(),
    "segmenter": LoopSettings(steps=200, batch=2, learning_rate=1e-3, checkpoint_steps=200),
}
GROUPS = ("network", "augmentation", "targets", "query")


@dataclass(frozen=True)
class Recipe:
    """Everything about a training but its data.

    Attributes:
        kind: detector or segmenter.
        network: module of `tcrdata.networks`, or a dotted path.
        network_settings: of the network.
        loop: of the loop.
        augmentation: of sweeps or images.
        targets: shape of a detector's targets.
        query: what a sample is.
        parameters: of the query, name to text.
    """

    kind: str
    network: str
    network_settings: Any
    loop: LoopSettings
    augmentation: Any
    targets: TargetSettings
    query: TrainingQuery
    parameters: Mapping[str, str]

    @property
    def transform(self) -> Any:
        """Makes a sample of a frame."""
        if self.kind == "segmenter":
            return SegmenterSamples(self.augmentation)
        return DetectorSamples(self.network, self.network_settings, self.augmentation, self.targets)

    def identity(
        self, selection_id: str, labels_round: int, snapshot: str, processes: int = 1
    ) -> ModelIdentity:
        """Return what a model of this recipe and data follows from.

        Args:
            selection_id: of the labels.
            labels_round: EM round of the labels.
            snapshot: the frozen list of files that is read.
            processes: that learn together: each takes a batch a step.
        """
        plain = {
            "network": settings.as_plain(self.network_settings),
            "loop": settings.as_plain(self.loop),
            "augmentation": settings.as_plain(self.augmentation),
            "targets": settings.as_plain(self.targets),
            "query": dict(sorted(self.parameters.items())),
        }
        # Where and how often it is loaded and saved leaves the numbers as they are.
        for name in ("workers", "checkpoint_steps"):
            del plain["loop"][name]
        if processes > 1:
            plain["loop"]["processes"] = processes
        return ModelIdentity(
            self.kind, self.network, labels_round, selection_id, snapshot, self.query.text,
            plain, self.loop.seed,
        )  # fmt: skip


def plan_recipe(kind: str, assignments: Mapping[str, str]) -> Recipe:
    """Return the recipe of a kind with `name=value` assignments applied.

    Args:
        kind: detector or segmenter.
        assignments: of the loop (`steps`), of a group (`network.widths`, `augmentation.yaw_rad`,
            `targets.spread`, `query.near_m`), or `network=NAME` and `query=NAME`.

    Raises:
        SettingsError: an unknown kind, name or value.
    """
    if kind not in NETWORKS:
        raise SettingsError(f"'{kind}' cannot be trained: choose one of {', '.join(NETWORKS)}")
    grouped = settings.grouped(assignments, GROUPS)
    own = grouped[""]
    network, query = own.pop("network", NETWORKS[kind]), own.pop("query", kind)
    module = registry.find("networks", network)
    if kind != module.KIND:
        raise SettingsError(f"network {network} is a {module.KIND}, not a {kind}")
    augmentation = SweepAugmentation() if kind == "detector" else ImageAugmentation()
    loaded = load_training_query(query)
    if getattr(module, "NEEDS_COLOURS", False) and "image" not in loaded.reads:
        loaded = TrainingQuery(loaded.name, loaded.text, (*loaded.reads, "image"))
    return Recipe(
        kind,
        network,
        settings.overridden(module.Settings(), grouped["network"], "network"),
        settings.overridden(LOOPS[kind], own, "train"),
        settings.overridden(augmentation, grouped["augmentation"], "augmentation"),
        settings.overridden(TargetSettings(), grouped["targets"], "targets"),
        loaded,
        grouped["query"],
    )


def run_training(
    store: Store,
    recipe: Recipe,
    *,
    selection_id: str,
    snapshot: str | None = None,
    resume: bool = False,
    device: str = "auto",
    report: Callable[[Report], None] = lambda _: None,
) -> tuple[ModelIdentity, Progress | None]:
    """Train on a selection's labels; the files of this moment are frozen first.

    Returns:
        the model, and how far it is; None when it was finished before.

    Raises:
        MissingEvidenceError: the selection has no positive labels, or there is nothing to resume.
        SettingsError: no such device or setting.
        TrainingError: the loss is not finite.
        StoreError: a damaged or foreign checkpoint.
        ConflictError: another training has finished the model meanwhile.
    """
    with training_place(device) as place:
        labels_round = _round_of(store, selection_id)
        if resume:
            wanted = recipe.identity(selection_id, labels_round, "", place.world_size)
            snapshot = _resumed_snapshot(store, wanted, snapshot)
        snapshot = snapshot or freeze_training_tables(store)
        model = recipe.identity(selection_id, labels_round, snapshot, place.world_size)
        done = {row["model_id"]: row["finished"] for row in model_rows(store)}
        if done.get(model.model_id):
            return model, None
        progress = _trained(store, recipe, model, place, resume and model.model_id in done, report)
        return model, progress


def _trained(
    store: Store,
    recipe: Recipe,
    model: ModelIdentity,
    place: Place,
    resume: bool,
    report: Callable[[Report], None],
) -> Progress:
    parameters = {**recipe.parameters, "selection_id": model.selection_id}
    frames = open_frames(store, recipe.query, snapshot=model.snapshot, parameters=parameters)
    return train(
        store, model, frames, recipe.transform, recipe.network_settings, recipe.loop, place,
        resume=resume, report=report,
    )  # fmt: skip


def _round_of(store: Store, selection_id: str) -> int:
    rows = store.read("selections", columns=["round"], dataset="_", selection_id=selection_id)
    if not rows.num_rows:
        raise MissingEvidenceError(f"{store.url}: no selection {selection_id}")
    return int(rows["round"][0].as_py())


def _resumed_snapshot(store: Store, wanted: ModelIdentity, snapshot: str | None) -> str:
    """Return the snapshot of the unfinished model of this recipe."""
    same = [
        row
        for row in model_rows(store)
        if row["selection_id"] == wanted.selection_id
        and snapshot in (None, row["snapshot"])
        and _recipe_of(row) == wanted.recipe
    ]
    open_ones = [row for row in same if not row["finished"]] or same
    if len(open_ones) == 1:
        return str(open_ones[0]["snapshot"])
    if open_ones:
        names = ", ".join(sorted(row["snapshot"] for row in open_ones))
        raise SettingsError(f"several models could go on: give --snapshot, one of {names}")
    raise MissingEvidenceError(
        f"{store.url}: no checkpoint of a {wanted.kind} with these settings and this selection "
        "to resume: see `tcrdata models`, or leave --resume out"
    )


def _recipe_of(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "kind": row["kind"],
        "network": row["network"],
        "query": row["query"],
        "settings": json.loads(row["settings"]),
        "seed": row["seed"],
    }
