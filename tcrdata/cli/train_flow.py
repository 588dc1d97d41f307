"""`tcrdata train flow`: a flow network, from scratch or finetuned on the frames it will measure."""

from __future__ import annotations

import os
import shlex
import time
from typing import TYPE_CHECKING, Any, Literal

from tcrdata import console
from tcrdata.cli.app import Assignments, Flag, StoreUrl, listed
from tcrdata.cli.train import training_progress
from tcrdata.errors import MissingEvidenceError, SettingsError
from tcrdata.settings import parse_assignments, read_toml

if TYPE_CHECKING:
    from tcrdata.learning.checkpoints import ModelIdentity
    from tcrdata.learning.flow_recipes import FlowRecipe
    from tcrdata.store import Store


def train_flow(
    *,
    store: StoreUrl,
    weights: str | None = None,
    model: str | None = None,
    model_store: str | None = None,
    from_scratch: Flag = False,
    generated: Flag = False,
    size: Literal["small", "full"] | None = None,
    losses: str | None = None,
    config: str | None = None,
    assignments: Assignments = (),
    resume: Flag = False,
    device: str = "auto",
    logs: str | None = None,
    json: Flag = False,
) -> int:
    """Finetune a flow network on a store's frames, without truth; or train one from scratch.

    The network that is in use is finetuned, or the one that is named. The last frames of each
    drive are held out: the student replaces its teacher only if a query over what both make of
    them says so. A store without any network gets one from scratch, taught by generated pairs.

    Args:
        store: folder or URL of the store; created when a network is trained from scratch.
        weights: file with the weights of RAFT, under the published names.
        model: id of the flow model to go on with.
        model_store: store that holds it, when it is another one.
        from_scratch: train a network on generated pairs, whatever the store holds.
        generated: go on with the network on larger generated pairs, whose flow is known.
        size: of RAFT: small or full; a file's own when left out.
        losses: of photometric, teacher and occlusion, with commas between; all when left out.
        config: TOML file of settings.
        assignments: NAME=VALUE, such as steps=400, pairs.width_px=448 or losses.teacher=0.2 (from
            scratch planes.shift_px=8); they win over the file.
        resume: go on from the newest checkpoint of the same settings.
        device: auto, cpu or cuda.
        logs: folder for TensorBoard's event files; needs tcrdata[logs]; none when left out.
        json: print the model and what was checked as JSON.
    """
    from tcrdata.learning.flow_runs import train_flow as run
    from tcrdata.store import open_store

    values = {**(read_toml(config) if config else {}), **parse_assignments(list(assignments))}
    named = weights or model or model_store
    if from_scratch and (named or losses or generated):
        raise SettingsError("--from-scratch learns from generated pairs alone: leave --weights, "
                            "--model, --generated and --losses out")  # fmt: skip
    opened = open_store(store, create=not named)
    start = None if from_scratch else _start(opened, weights, model, model_store, size)
    recipe = _recipe(start, size, losses, values, generated=generated)
    _bring(opened, weights, model, model_store, size)
    started = time.perf_counter()
    with training_progress(recipe.loop.steps, logs) as report:
        made, progress = run(opened, recipe, resume=resume, device=device, report=report)
    if int(os.environ.get("RANK", "0")):
        return 0  # of several processes one checks and speaks
    if progress is None:
        console.say(f"nothing to do: model {made.model_id} is finished")
    else:
        taught = "taught by generated pairs" if recipe.planes else "finetuned"
        taught += f" from {start['model_id']}" if start else ""
        console.say(
            f"model {made.model_id}: RAFT {recipe.network.size}, {taught}, {progress.step:,} steps,"
            f" last loss {progress.losses[-1]:.3f}, in {time.perf_counter() - started:.1f} s"
        )
    _finish(opened, recipe, made, store, device, json)
    return 0


def _recipe(
    start: dict[str, Any] | None,
    size: str | None,
    losses: str | None,
    values: dict[str, str],
    *,
    generated: bool,
) -> FlowRecipe:
    from tcrdata.learning.flow_recipes import plan_finetuning, plan_on_generated

    if start is not None and not generated:
        return plan_finetuning(start, listed(losses), values)
    if losses and generated:
        raise SettingsError("--generated learns from known flow: leave --losses out")
    if losses:
        raise SettingsError(
            "--losses finetunes, but the store has no flow network yet: give --weights FILE, or "
            "train one from scratch first"
        )
    return plan_on_generated(size, values, start)


def _start(
    store: Store, weights: str | None, model: str | None, model_store: str | None, size: str | None
) -> dict[str, Any] | None:
    """Return the model to go on with; None when the store has none and none is named."""
    from tcrdata.flow_models import file_identity, flow_model
    from tcrdata.store import open_store

    if weights and (model or model_store):
        raise SettingsError("--weights and --model name two networks: give one")
    if weights:
        found = file_identity(weights, size)[0]
        return {"model_id": found.model_id, "settings": found.settings}
    source = open_store(model_store) if model_store else store
    row = flow_model(source, model)
    if row is None and model_store:
        raise MissingEvidenceError(f"{source.url}: no flow network: see `tcrdata models`")
    if row is not None and size not in (None, row["settings"]["network"]["size"]):
        raise SettingsError(
            f"--size {size}: model {row['model_id']} is RAFT {row['settings']['network']['size']}; "
            "leave --size out, or add --from-scratch"
        )
    return row


def _bring(
    store: Store, weights: str | None, model: str | None, model_store: str | None, size: str | None
) -> None:
    """Put the network to go on with into the store: what is refused before leaves it as it was."""
    from tcrdata.flow_models import copy_model, import_weights
    from tcrdata.store import open_store

    if weights:
        import_weights(store, weights, size)
    elif model_store:
        copy_model(open_store(model_store), store, model)


def _finish(
    store: Store, recipe: FlowRecipe, model: ModelIdentity, url: str, device: str, json: bool
) -> None:
    """Check a student on what was held out, and say what became of it."""
    from tcrdata.flow_models import flow_models
    from tcrdata.learning.flow_checks import check_flow

    if recipe.teacher:
        with console.progress_bars() as bar:
            task = bar.add_task("check", total=None)
            check_flow(
                store, recipe, model, lambda done, all: bar.update(task, completed=done, total=all),
                device,
            )  # fmt: skip
    rows = flow_models(store)
    row = next(row for row in rows if row["model_id"] == model.model_id)
    if json:
        console.print_json(row)
    if recipe.teacher:
        in_use = ", ".join(other["model_id"] for other in rows if other["in_use"])
        console.say(
            f"{row['state']} on {row['pairs']} pairs held out: consistent "
            f"{_change(row, 'consistent_share')}, photometric error "
            f"{_change(row, 'photometric_error')}; in use: {in_use or 'none'}"
        )
    console.say(f"next: tcrdata build ... --flow raft --store {shlex.quote(url)}")


def _change(row: dict[str, Any], name: str) -> str:
    """From the teacher's number to the student's; a dash where no pixel gave one."""
    return " -> ".join(
        "-" if value is None else f"{value:.4f}" for value in (row[f"teacher_{name}"], row[name])
    )
