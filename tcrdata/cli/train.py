"""`tcrdata train`: a detector or segmenter from a selection's labels."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Literal

from tcrdata import console
from tcrdata.cli.app import Assignments, Flag, StoreUrl
from tcrdata.cli.selected import selected
from tcrdata.settings import parse_assignments, read_toml

if TYPE_CHECKING:
    from tcrdata.learning.training import Report


def train(
    kind: Literal["detector", "segmenter"],
    /,
    *,
    store: StoreUrl,
    selection: str | None = None,
    snapshot: str | None = None,
    config: str | None = None,
    assignments: Assignments = (),
    resume: Flag = False,
    device: str = "auto",
    logs: str | None = None,
    json: Flag = False,
) -> int:
    """Train on the labels of a selection; checkpoints land in the store.

    What is in the store now is frozen first: what lands later does not change the training. Under
    `torchrun` several GPUs train together.

    Args:
        kind: detector (3D) or segmenter (2D).
        store: folder or URL of the store.
        selection: name or id of the labels' selection; the newest when left out.
        snapshot: a frozen list of files to read instead of the newest.
        config: TOML file of settings: those of the loop at the top, then tables [network],
            [augmentation], [targets], [query].
        assignments: NAME=VALUE, such as steps=800, network.widths=32,64,96 or
            augmentation.yaw_rad=3.14; they win over the file.
        resume: go on from the newest checkpoint of the same settings.
        device: auto, cpu or cuda.
        logs: folder for TensorBoard's event files; needs tcrdata[logs]; none when left out.
        json: print the model as JSON.
    """
    from tcrdata.store import open_store

    values = {**(read_toml(config) if config else {}), **parse_assignments(list(assignments))}
    opened = open_store(store)
    selection_id = selected(opened, selection)
    # Loaded when it is known that there is something to train on.
    from tcrdata.learning.runs import plan_recipe, run_training
    from tcrdata.trainings import unheard_presets

    recipe = plan_recipe(kind, values)
    if unheard := ", ".join(unheard_presets(opened, selection_id)):
        console.say(
            f"warning: what {unheard} takes was not measured when these labels were selected, so "
            f"that parked things are background here: build with --preset {unheard}, select again"
        )
    started = time.perf_counter()
    with training_progress(recipe.loop.steps, logs) as report:
        model, progress = run_training(
            opened,
            recipe,
            selection_id=selection_id,
            snapshot=snapshot,
            resume=resume,
            device=device,
            report=report,
        )
    if int(os.environ.get("RANK", "0")):
        return 0  # of several processes one speaks
    if json:
        console.print_json({"model_id": model.model_id, "snapshot": model.snapshot,
                            "step": progress.step if progress else recipe.loop.steps,
                            "terms": progress.terms if progress else None})  # fmt: skip
    if progress is None:
        console.say(f"nothing to do: model {model.model_id} is finished")
    else:
        console.say(
            f"model {model.model_id}: {kind} of {progress.samples:,} frames and "
            f"{progress.positives:,} positive labels, {progress.step:,} steps, "
            f"last loss {progress.losses[-1]:.3f}, in {time.perf_counter() - started:.1f} s"
        )
    console.say(f"next: tcrdata models --store {shlex.quote(store)}")
    return 0


@contextmanager
def training_progress(steps: int, logs: str | None = None) -> Iterator[Callable[[Report], None]]:
    """Show steps, loss, throughput and time left on stderr; silent when not a terminal.

    Args:
        steps: of the whole training.
        logs: folder for event files; none for None.
    """
    from tcrdata.learning.logs import EventLogs

    events = EventLogs(logs) if logs else None
    with console.progress_bars() as bar, events or nullcontext():
        task = bar.add_task("train", total=steps)

        def advance(report: Report) -> None:
            said = f"loss {report.loss:.3f}, {report.frames_per_s:.1f} frames/s"
            bar.update(task, completed=report.step, description=said)
            if events:
                events.add(report)

        yield advance
