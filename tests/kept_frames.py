"""Generated frames kept in memory: what many builds of one module read is cast and drawn once."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tcrdata.datasets.demo import Demo
from tcrdata.datasets.street import StreetDrive

MADE = ("read_points", "read_image", "ground_truth")


@contextmanager
def kept_frames() -> Iterator[None]:
    """Let what a generated drive or clip gives be made once; each reader gets a copy of its own."""
    with pytest.MonkeyPatch.context() as patch:
        for dataset in (Demo, StreetDrive):
            for name in MADE:
                patch.setattr(dataset, name, kept(getattr(dataset, name)))
        yield


def kept(make: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a method that makes the same but once, of the same specification."""
    made: dict[Any, Any] = {}

    def copied(dataset: Any, of: Any) -> Any:
        frame = (of.sequence, of.frame) if hasattr(of, "sequence") else of
        key = (dataset.spec, frame)
        if key not in made:
            made[key] = make(dataset, of)
        return copy.deepcopy(made[key])

    return copied
