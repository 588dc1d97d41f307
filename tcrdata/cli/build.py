"""`tcrdata build`: evidence and labels of a dataset's frames."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tcrdata import console
from tcrdata.cli import printing
from tcrdata.cli.app import Assignments, Flag, StoreUrl, listed
from tcrdata.errors import SettingsError
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.settings import parse_assignments, read_toml

if TYPE_CHECKING:
    from tcrdata.types import Generation

MOST_WORKERS_BY_DEFAULT = 8


def build(
    *,
    dataset: str,
    store: StoreUrl,
    root: str = "",
    generate: str = "",
    renderer: str | None = None,
    sequences: str | None = None,
    frames: str | None = None,
    rounds: int = 1,
    tracking: Literal["on", "off"] = "off",
    preset: str = "tcrdata",
    flow: Literal["dis", "raft"] | None = None,
    weights: str | None = None,
    model: str | None = None,
    workers: int | None = None,
    config: str | None = None,
    assignments: Assignments = (),
    snapshot: str | None = None,
    dry_run: Flag = False,
    json: Flag = False,
) -> int:
    """Measure the evidence of a dataset's frames into a store and select labels.

    What is done already is left as it is; a build that was stopped goes on where it was.

    Args:
        dataset: kitti, cater, demo, street, or the dotted path of an adapter.
        store: folder or URL of the store; created when absent.
        root: where the dataset lies; generated datasets take a spec such as `seed=1,frames=50`.
        generate: so many clips of a dataset that can generate them, or a spec such as
            `clips=10,seed=3,hard=true`; with --root they are written there, without they are drawn
            each time they are read: to track them, or train on them, give one.
        renderer: what draws their images: raycast (the default), or blender, which writes them to
            --root, or else beside the store; it needs bpy, and takes `--set blender.samples=4`.
        sequences: only these, with commas between.
        frames: only these of each sequence: `0-49`, `0-9,20,30-`.
        rounds: rounds of the EM loop; those after the first train on the labels of the one before.
        tracking: whether each round's labels are tracked, and decided again with what that adds, by
            the preset that names theirs in `-- follows:`; the next round trains on that.
        preset: presets to select labels with, with commas between, or `all`.
        flow: what measures optical flow, for presets that read it: dis (the default) or raft.
        weights: file with the weights of RAFT; they are copied into the store.
        model: id of a flow model of the store; the one in use when left out.
        workers: worker processes; the machine's cores when left out.
        config: a TOML file of settings.
        assignments: `cue.field=value` for a cue, `parameter=value` for a rule, `train.name=value`
            for the trainings between rounds, `blender.name=value` for that renderer.
        snapshot: select labels from the evidence of this snapshot, not from what is made now.
        dry_run: say what would be made and stop.
        json: print the report as JSON.
    """
    count = _started_workers(workers, dry_run=dry_run)
    from tcrdata.dry_runs import dry_rounds
    from tcrdata.flow_models import check_presets_read_flow, flow_assignments
    from tcrdata.inspection.drift import drifts
    from tcrdata.rounds import build_rounds, plan_rounds
    from tcrdata.store import open_store

    _check_rounds(rounds, tracking, snapshot)
    values = {**(read_toml(config) if config else {}), **parse_assignments(list(assignments))}
    if generate:
        root = root or _beside(store, renderer)
        root = _generated(dataset, generate, root, renderer, values, work=not dry_run)
    elif renderer:
        raise SettingsError("--renderer draws clips that are generated: add --generate N")
    check_presets_read_flow(flow, listed(preset) or ())
    values |= flow_assignments(store, flow, weights, model, dry_run=dry_run)
    loop = plan_rounds(
        dataset,
        root,
        rounds=rounds,
        sequences=listed(sequences),
        frames=parse_frame_ranges(frames),
        presets=listed(preset) or (),
        assignments=values,
        tracking=tracking == "on",
    )
    started = time.perf_counter()
    if dry_run:
        report = dry_rounds(loop, store)
    else:
        with console.build_progress(loop.units) as bar:
            report = build_rounds(
                loop,
                store,
                workers=count,
                progress=bar.advance,
                trained=bar.trained,
                snapshot=snapshot,
            )
    seconds = time.perf_counter() - started
    leading = [selection.selection_id for selection in report.leading]
    found = drifts(open_store(store), leading) if len(leading) > 1 else []
    if json:
        console.print_json(printing.build_json(report, seconds, found))
    else:
        printing.print_drifts(found)
        printing.print_build(report, loop.first.sequences, store, seconds, only_plan=dry_run)
    return 1 if report.count("failed") else 0


def _started_workers(workers: int | None, *, dry_run: bool) -> int:
    """Return how many workers are to work; more than one begin to get ready before all else."""
    from tcrdata import executors

    count = workers if workers is not None else default_workers()
    if count < 1:
        raise SettingsError(f"--workers {count}: at least one is needed")
    if count > 1 and not dry_run:
        executors.start_server()
    return count


def _check_rounds(rounds: int, tracking: str, snapshot: str | None) -> None:
    """Raise SettingsError for rounds that cannot be."""
    if rounds < 1:
        raise SettingsError(f"--rounds {rounds}: at least one is needed")
    if rounds > 1 and snapshot is not None:
        raise SettingsError("--snapshot fixes the evidence: later rounds would measure anew")
    if tracking == "on" and snapshot is not None:
        raise SettingsError("--snapshot fixes the evidence: what tracking adds would not be in it")


def _beside(store: str, renderer: str | None) -> str:
    """Return a folder beside a local store for clips whose images are rendered; else none."""
    if renderer in (None, "raycast") or "://" in store:
        return ""
    return f"{store.rstrip('/')}-clips"


def _generated(
    dataset: str, text: str, root: str, renderer: str | None, values: dict[str, str], *, work: bool
) -> str:
    """Return the root of generated clips, which are written first where a folder is named.

    Without work, clips that no folder holds yet are looked at as they would be generated. What
    `values` has for the renderer is taken out of them.
    """
    from tcrdata import registry

    module = registry.find("datasets", dataset)
    if not hasattr(module, "generate"):
        raise SettingsError(f"--generate: the dataset {dataset} generates no clips; leave it out")
    given: dict[str, Any] = {}
    if renderer is not None:
        if renderer not in getattr(module, "RENDERERS", ()):
            known = ", ".join(getattr(module, "RENDERERS", ())) or "none to choose"
            raise SettingsError(f"--renderer {renderer}: the dataset {dataset} has {known}")
        prefix = f"{renderer}."
        names = [name for name in values if name.startswith(prefix)]
        given["renderer"] = renderer
        given["options"] = {name.removeprefix(prefix): values.pop(name) for name in names}
    generation: Generation = module.generate(text, root, **given)
    if work:
        console.follow("generate", generation.steps, generation.work)
    elif not Path(root).is_dir():
        generation = module.generate(text, "")
    return generation.root


def default_workers() -> int:
    """Return as many workers as cores, eight at most."""
    return min(len(os.sched_getaffinity(0)), MOST_WORKERS_BY_DEFAULT)
