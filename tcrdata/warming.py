"""Compiles the numeric kernels once, so that no build waits for them."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace

from tcrdata.executors import Serial
from tcrdata.pipeline import build_sequence, plan_build
from tcrdata.rules import select
from tcrdata.store import open_store
from tcrdata.track_plans import plan_tracking
from tcrdata.track_runs import track

CLIPS = (("street", "frames=3,images=true"), ("demo", "frames=3"))
LOOSE = "paper"  # a preset that labels something in so few frames


def warm() -> int:
    """Build a few generated frames in memory with every preset, and track; return the units made.

    The compiled kernels are cached beside the installed package, or where NUMBA_CACHE_DIR says.
    """
    made = 0
    whole = plan_build(*CLIPS[0], presets=("all",))
    for dataset, spec in CLIPS:
        clip = plan_build(dataset, spec)
        plan = replace(whole, dataset=dataset, root=clip.root, sequences=clip.sequences)
        url = f"memory://warm-{dataset}"
        store = open_store(url, create=True)
        for sequence in plan.sequences:
            with contextlib.redirect_stdout(io.StringIO()):
                outcomes = list(build_sequence(store, plan, sequence, Serial()))
            made += sum(outcome.state == "made" for outcome in outcomes)
        labels = select(open_store(url), LOOSE)
        if labels.labels:
            tracking = plan_tracking(open_store(url), labels.selection_id)
            made += len(track(url, tracking, workers=1, progress=lambda _: None))
    return made
