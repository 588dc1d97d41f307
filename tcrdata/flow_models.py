"""Which network measures flow: one of a file, one that is named, or the one that SQL promotes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.plan import ROUND, ordered_cues
from tcrdata.reports import run_report
from tcrdata.rules import load_preset
from tcrdata.store import Store, open_store

if TYPE_CHECKING:
    from tcrdata.evidence.flow_estimators import Estimator
    from tcrdata.learning.checkpoints import ModelIdentity

KIND = "flow"


def flow_models(store: Store, parameters: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return every flow network of a store, what was measured on held-out pairs, and its state.

    Args:
        store: that holds them.
        parameters: of `queries/reports/flow_models.sql`.
    """
    connection = store.connect(tables=("models", "flow_checks"))
    relation = run_report(connection, "flow_models", parameters)
    rows = [dict(zip(relation.columns, row, strict=True)) for row in relation.fetchall()]
    return [{**row, "settings": json.loads(row["settings"])} for row in rows]


def flow_model(store: Store, model: str | None = None) -> dict[str, Any] | None:
    """Return the network of an id's beginning, or the one in use; None when the store has none.

    Raises:
        MissingEvidenceError: no finished network is named so.
        SettingsError: several are.
    """
    rows = [row for row in flow_models(store) if row["finished"]]
    if model is not None:
        found = [row for row in rows if row["model_id"].startswith(model)]
        if not found:
            raise MissingEvidenceError(
                f"{store.url}: no finished flow model '{model}': see `tcrdata models --kind flow`"
            )
    else:
        found = [row for row in rows if row["in_use"]]
    if len(found) > 1:
        names = ", ".join(sorted(row["model_id"] for row in found))
        raise SettingsError(f"{store.url}: several flow models fit: give --model, one of {names}")
    return found[0] if found else None


def file_identity(path: str, size: str | None = None) -> tuple[ModelIdentity, dict[str, Any]]:
    """Return the model that a file of weights stands for, and its weights.

    Raises:
        SettingsError: the file holds no weights of RAFT; see `read_raft_weights`.
    """
    from tcrdata import settings
    from tcrdata.learning.checkpoints import ModelIdentity
    from tcrdata.networks.raft import Settings
    from tcrdata.networks.raft_weights import read_raft_weights, weights_digest

    found, state = read_raft_weights(path, size)
    plain = {
        "network": settings.as_plain(Settings(size=found)),
        "weights_sha256": weights_digest(state),
    }
    return ModelIdentity(KIND, "raft", ROUND, "", "", "", plain, 0), state


def import_weights(store: Store, path: str, size: str | None = None) -> str:
    """Put the weights of a file into a store, once; return the model's id.

    Raises:
        SettingsError: the file holds no weights of RAFT.
    """
    from tcrdata.learning.checkpoints import AVERAGE, Progress, model_rows, save_checkpoint

    identity, state = file_identity(path, size)
    if identity.model_id not in {row["model_id"] for row in model_rows(store)}:
        parameters = sum(value.numel() for value in state.values())
        progress = Progress(0, 0, (), {}, 0, 0, parameters)
        save_checkpoint(store, identity, progress, {AVERAGE: state})
    return identity.model_id


def copy_model(source: Store, target: Store, model: str | None = None) -> str:
    """Copy a finished flow network into another store, once; return its id.

    Raises:
        MissingEvidenceError: there is none, or none of this id.
    """
    from tcrdata.learning.checkpoints import (
        AVERAGE,
        ModelIdentity,
        Progress,
        model_rows,
        read_weights,
        save_checkpoint,
    )

    chosen = flow_model(source, model)
    if chosen is None:
        raise MissingEvidenceError(f"{source.url}: no flow network: see `tcrdata models`")
    row = next(row for row in model_rows(source) if row["model_id"] == chosen["model_id"])
    done = {known["model_id"] for known in model_rows(target) if known["finished"]}
    if row["model_id"] not in done:
        names = ("kind", "network", "labels_round", "selection_id", "snapshot", "query", "seed")
        own = {name: row[name] for name in names}
        identity = ModelIdentity(settings=json.loads(row["settings"]), **own)
        progress = Progress(
            row["step"], row["steps"], tuple(row["losses"]), dict(row["terms"]), row["samples"],
            row["positives"], row["parameters"],
        )  # fmt: skip
        parts = {AVERAGE: read_weights(source, row["model_id"], AVERAGE)}
        save_checkpoint(target, identity, progress, parts)
    return str(row["model_id"])


def check_presets_read_flow(flow: str | None, presets: Sequence[str]) -> None:
    """Refuse to choose what measures flow for presets that read none.

    Raises:
        SettingsError: none of the presets reads the cue `flow`.
    """
    if flow is None or "all" in presets:
        return
    cues = {cue for name in presets for cue in load_preset(name).cues}
    if "flow" not in ordered_cues(cues):
        raise SettingsError(
            f"--flow {flow}: preset {', '.join(presets)} reads no flow: name one that does: "
            "--preset paper"
        )


def flow_assignments(
    store_url: str | None,
    flow: str | None,
    weights: str | None,
    model: str | None,
    *,
    dry_run: bool = False,
) -> dict[str, str]:
    """Return the settings of the cue `flow` for what was asked for.

    Args:
        store_url: holds the networks, and gets the weights of a file; created for these.
        flow: dis or raft; None leaves the settings alone.
        weights: file of RAFT's weights.
        model: id of a model.
        dry_run: write nothing.

    Raises:
        SettingsError: weights or a model without `raft`, both, or a file that holds none.
        MissingEvidenceError: there is no network to measure with.
    """
    if flow != "raft" and (weights or model):
        raise SettingsError("--weights and --model are for --flow raft")
    if weights and model:
        raise SettingsError("--weights and --model name two networks: give one")
    if flow is None:
        return {}
    if flow == "dis":
        return {"flow.method": "dis"}
    if weights and (dry_run or store_url is None):
        chosen = file_identity(weights)[0].model_id
    elif weights:
        chosen = import_weights(open_store(str(store_url), create=True), weights)
    else:
        opened = open_store(store_url, create=not dry_run) if store_url else None
        row = flow_model(opened, model) if opened else None
        if row is None:
            raise MissingEvidenceError(
                "--flow raft: the store has no flow network: give --weights FILE, or run "
                "`tcrdata train flow`"
            )
        chosen = str(row["model_id"])
    return {"flow.method": "raft", "flow.model": chosen}


def named_estimator(
    flow: str,
    weights: str | None,
    model: str | None,
    store_url: str | None,
    iterations: int | None = None,
) -> Estimator:
    """Return an estimator outside of any build.

    Args:
        flow: dis or raft.
        weights: file of RAFT's weights.
        model: id of a model; the one in use when neither is given.
        store_url: holds the model.
        iterations: RAFT's; None for as many as a build makes.

    Raises:
        SettingsError: nothing names the network, or more than one thing does; iterations of DIS.
        TcrdataError: it is not there.
    """
    from tcrdata.evidence.flow import Settings, chosen_estimator
    from tcrdata.evidence.flow_estimators import Dis, Raft

    own = Settings("raft") if iterations is None else Settings("raft", iterations=iterations)
    if weights and flow == "raft" and not model:
        from tcrdata.networks.trained import to_bytes

        identity, state = file_identity(weights)
        plain = json.dumps(identity.settings["network"], sort_keys=True)
        return Raft(identity.model_id, plain, to_bytes(state), own.iterations)
    if flow == "dis":
        flow_assignments(None, flow, weights, model)
        if iterations is not None:
            raise SettingsError("--iterations is for --flow raft")
        return Dis()
    if store_url is None:
        raise SettingsError("--flow raft: give --weights FILE, or --model-store with its networks")
    chosen = flow_assignments(store_url, flow, weights, model, dry_run=True)["flow.model"]
    return chosen_estimator(open_store(store_url), replace(own, model=chosen))
