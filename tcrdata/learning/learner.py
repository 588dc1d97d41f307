"""What learns: a network, its averaged copy and its optimiser, one step at a time."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from tcrdata import registry
from tcrdata.learning.checkpoints import AVERAGE, STATE, ModelIdentity, read_weights
from tcrdata.learning.devices import Place
from tcrdata.networks.losses import OBJECTIVES
from tcrdata.networks.trained import load_state
from tcrdata.store import Store

Batch = dict[str, Any]
Objective = Callable[[Mapping[str, torch.Tensor], Batch], dict[str, torch.Tensor]]


@dataclass(frozen=True)
class LearnerSettings:
    """How a step changes the weights.

    Attributes:
        learning_rate: largest of the cycle.
        weight_decay: of AdamW.
        clip: largest norm of the gradient.
        average: decay of the running average of the weights.
        mixed_precision: half precision where it helps: on a GPU.
        seed: of weights, order and augmentation.
    """

    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    clip: float = 10.0
    average: float = 0.99
    mixed_precision: bool = True
    seed: int = 0


class Learner:
    """A network in training.

    Attributes:
        network: what is trained.
        averaged: its running average: what evidence will be measured with.
        terms: the parts of the loss of each step so far.
    """

    def __init__(
        self,
        kind: str,
        network: str,
        settings: Any,
        own: LearnerSettings,
        place: Place,
        *,
        objective: Objective | None = None,
        start: Mapping[str, torch.Tensor] | None = None,
        start_counts: bool = False,
    ) -> None:
        """Make the network; the seed makes its weights, unless it starts from others.

        Args:
            kind: detector or segmenter.
            network: its module.
            settings: of the network.
            own: how it learns.
            place: device and process.
            objective: the parts of the loss, from outputs and batch; None for the kind's own.
            start: weights to begin with; None for random ones.
            start_counts: the running average is of these, too: it stays near them.
        """
        torch.manual_seed(own.seed)
        self.network: nn.Module = registry.find("networks", network).make_network(settings)
        if start is not None:
            load_state(self.network, start, "the weights to start from")
        self.network.to(place.device, memory_format=torch.channels_last).train()
        self.averaged = copy.deepcopy(self.network)
        self.terms: list[dict[str, float]] = []
        self._start_counts = start_counts
        self._own, self._device = own, torch.device(place.device).type
        self._objective: Objective = objective or OBJECTIVES[kind]
        self._optimizer = torch.optim.AdamW(
            self.network.parameters(), weight_decay=own.weight_decay
        )
        self._half = own.mixed_precision and self._device == "cuda"
        self._scaler = torch.amp.GradScaler(self._device, enabled=self._half)
        several = place.world_size > 1
        self._spread = (
            nn.parallel.DistributedDataParallel(self.network) if several else self.network
        )

    def step(self, batch: Batch, rate: float) -> dict[str, float]:
        """Learn from one batch; return the parts of its loss; one not finite changes nothing.

        A finite loss may have a gradient that is not: then its norm is among the parts.

        Args:
            batch: `input` and the targets, tensors (B, ...).
            rate: factor of the learning rate.
        """
        for group in self._optimizer.param_groups:
            group["lr"] = self._own.learning_rate * rate
        with torch.autocast(self._device, enabled=self._half):
            outputs = self._spread(batch["input"])
        parts = self._objective({name: o.float() for name, o in outputs.items()}, batch)
        terms = {name: float(part.detach()) for name, part in parts.items()}
        loss = torch.stack(list(parts.values())).sum()
        if not bool(torch.isfinite(loss.detach())):
            return terms
        self._optimizer.zero_grad()
        self._scaler.scale(loss).backward()
        self._scaler.unscale_(self._optimizer)
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self._own.clip)
        # In half precision the scaler leaves such a step out by itself.
        if not self._half and not bool(torch.isfinite(norm)):
            return {**terms, "gradient": float(norm)}
        self._scaler.step(self._optimizer)
        self._scaler.update()
        young = 1.0 if self._start_counts else (len(self.terms) + 1) / (len(self.terms) + 10)
        self._average(min(self._own.average, young))
        self.terms.append(terms)
        return terms

    def parts(self) -> dict[str, Any]:
        """Return what a checkpoint holds."""
        state = {
            "network": self.network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "scaler": self._scaler.state_dict(),
            "terms": self.terms,
        }
        return {AVERAGE: self.averaged.state_dict(), STATE: state}

    def restore(self, store: Store, model: ModelIdentity) -> None:
        """Go on from the newest checkpoint of a model.

        Raises:
            StoreError: it is damaged, or another architecture's.
            MissingEvidenceError: there is none.
        """
        what = f"{store.url}: model {model.model_id}"
        state = read_weights(store, model.model_id, STATE)
        load_state(self.network, state["network"], what)
        load_state(self.averaged, read_weights(store, model.model_id, AVERAGE), what)
        self._optimizer.load_state_dict(state["optimizer"])
        self._scaler.load_state_dict(state["scaler"])
        self.terms = list(state["terms"])

    @torch.no_grad()
    def _average(self, decay: float) -> None:
        """Move the averaged weights a step towards the network's."""
        pairs = zip(
            self.averaged.state_dict().values(), self.network.state_dict().values(), strict=True
        )
        for mean, value in pairs:
            if mean.is_floating_point():
                mean.lerp_(value, 1 - decay)
            else:
                mean.copy_(value)
