"""Compiles the numeric kernels once, so that no build waits for them."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace

from tcrdata.executors import Serial
from tcrdata.pipeline import build_sequence, plan_build
from tcrdata.store import open_store

CLIPS = (("street", "frames=4,images=true"), ("demo", "frames=4"))


def warm() -> int:
    """Build a few generated frames in memory with every preset; return the units made.

    The compiled kernels are cached beside the installed package, or where NUMBA_CACHE_DIR says.
    """
    made = 0
    whole = plan_build(*CLIPS[0], presets=("all",))
    for dataset, spec in CLIPS:
        clip = plan_build(dataset, spec)
        plan = replace(whole, dataset=dataset, root=clip.root, sequences=clip.sequences)
        store = open_store(f"memory://warm-{dataset}", create=True)
        for sequence in plan.sequences:
            with contextlib.redirect_stdout(io.StringIO()):
                outcomes = list(build_sequence(store, plan, sequence, Serial()))
            made += sum(outcome.state == "made" for outcome in outcomes)
    return made
