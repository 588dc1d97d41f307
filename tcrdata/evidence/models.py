"""Which trained model a cue measures with, read from the tables of `models` and `weights`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from tcrdata.errors import EvidenceError
from tcrdata.store import Store, open_store
from tcrdata.types import Tables

if TYPE_CHECKING:
    from tcrdata.networks.trained import Trained

AVERAGE = "average"
COLUMNS = ("model_id", "kind", "network", "labels_round", "settings", "finished")


@dataclass(frozen=True)
class ModelChoice:
    """What a cue asks for.

    Attributes:
        kind: detector or segmenter.
        model: id or its beginning; empty for the one of the newest earlier round.
        store: URL of another store that holds it; empty for the cue's own.
        round: EM round of the cue: its models learnt from labels of earlier rounds.
    """

    kind: str
    model: str
    store: str
    round: int


@dataclass(frozen=True)
class Model:
    """A model as workers get it: equal ones are made into a network once.

    Attributes:
        model_id: of the model.
        network: name of its module.
        plain: its network's settings as JSON.
        weights: bytes of the averaged weights.
    """

    model_id: str
    network: str
    plain: str
    weights: bytes


def read_model(tables: Tables | Store, choice: ModelChoice) -> Model:
    """Return the model that a cue asks for, with its weights.

    Raises:
        EvidenceError: there is none, several fit, or its weights are gone.
    """
    row = chosen_model(tables, choice)
    weights = model_weights(tables, choice, row["model_id"])
    plain = json.dumps(json.loads(row["settings"])["network"], sort_keys=True)
    return Model(row["model_id"], row["network"], plain, weights)


@lru_cache(maxsize=1)
def network_of(model: Model) -> Trained:
    """Return the network of a model; made once a worker."""
    from tcrdata.networks.trained import trained_network

    what = f"model {model.model_id}"
    return trained_network(model.network, json.loads(model.plain), model.weights, what)


def chosen_model(tables: Tables | Store, choice: ModelChoice) -> dict[str, Any]:
    """Return the row of `models` that a cue asks for.

    Raises:
        EvidenceError: there is none, it is of another kind or unfinished, or several fit.
    """
    rows = [row for row in _read(tables, choice, "models", COLUMNS) if _fits(row, choice)]
    what = f"{choice.kind} '{choice.model}'" if choice.model else choice.kind
    if not rows:
        taught = "" if choice.kind == "flow" else " on the labels of the round before"
        raise EvidenceError(
            f"no trained {what} for round {choice.round}: run `tcrdata train {choice.kind}`{taught}"
            ", or name a model that `tcrdata models` lists"
        )
    newest = max(row["labels_round"] for row in rows)
    last = [row for row in rows if row["labels_round"] == newest]
    if len(last) > 1:
        names = ", ".join(sorted(str(row["model_id"]) for row in last))
        raise EvidenceError(f"several models fit: set model to one of {names}")
    return last[0]


def model_weights(tables: Tables | Store, choice: ModelChoice, model_id: str) -> bytes:
    """Return the bytes of a model's averaged weights.

    Raises:
        EvidenceError: the store does not hold them.
    """
    columns = ("model_id", "part", "data")
    rows = _read(tables, choice, "weights", columns, model_id=model_id, part=AVERAGE)
    if not rows:
        raise EvidenceError(f"the weights of model {model_id} are not in the store: train it again")
    return bytes(rows[0]["data"])


def _read(
    tables: Tables | Store, choice: ModelChoice, table: str, columns: tuple[str, ...], **equals: Any
) -> list[dict[str, Any]]:
    source: Any = open_store(choice.store) if choice.store else tables
    return list(source.read(table, columns=list(columns), **equals).to_pylist())


def _fits(row: Mapping[str, Any], choice: ModelChoice) -> bool:
    """A model or store that is named is taken whatever the round: who names it knows why."""
    if row["kind"] != choice.kind or not row["finished"]:
        return False
    if choice.model:
        return str(row["model_id"]).startswith(choice.model)
    return bool(choice.store or row["labels_round"] < choice.round)
