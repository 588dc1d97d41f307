"""`tcrdata evaluate flow`: flow scored against known flow."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

from tcrdata import console
from tcrdata.cli.app import Flag
from tcrdata.errors import SettingsError

if TYPE_CHECKING:
    from tcrdata.evaluation.flow import FlowScore
    from tcrdata.flow_evaluation import ScoredFlow

COLUMNS = (
    "pairs", "of", "flow", "size", "known px", "EPE px", "Fl", "consistent", "EPE there", "else",
    "moving",
)  # fmt: skip


def evaluate_flow(
    *,
    root: str | None = None,
    store: str | None = None,
    dataset: str | None = None,
    flow: Literal["dis", "raft"] | None = None,
    weights: str | None = None,
    model: str | None = None,
    model_store: str | None = None,
    iterations: int | None = None,
    json: Flag = False,
) -> int:
    """Score flow: endpoint error, outliers, and both where the cycle test holds and where it fails.

    Args:
        root: folder of pairs with known flow (KITTI, FlyingChairs, Middlebury), found by looking;
            with --dataset the spec of a generated one.
        store: score the flow that a build left in this store instead.
        dataset: demo, cater or street: score consecutive frames against exact flow.
        flow: dis (the default) or raft.
        weights: file with the weights of RAFT.
        model: id of a flow model; the one in use when left out.
        model_store: store that holds it.
        iterations: of RAFT (8).
        json: print every pair as JSON.
    """
    from tcrdata.evaluation.flow import PROTOCOL

    if (root is None and dataset is None) == (store is None):
        raise SettingsError("give --root DIR (or --dataset), or --store STORE: one of them")
    if store is not None and (flow or weights or model or model_store or iterations is not None):
        raise SettingsError(
            "--store scores the flow that is in it: build with --flow, or give --root"
        )
    scored = []
    with console.progress_bars() as bar:
        task = bar.add_task("pairs", total=None)
        for one in _scored(root, store, dataset, (flow, weights, model, model_store, iterations)):
            scored.append(one)
            bar.advance(task)
    if json:
        console.print_json([_plain(one) for one in scored])
        return 0
    sys.stdout.write(PROTOCOL + "\n\n")
    console.print_table("", COLUMNS, _rows(scored, each=root is not None and dataset is None))
    return 0


def _scored(
    root: str | None, store: str | None, dataset: str | None, estimator: tuple[Any, ...]
) -> Iterator[ScoredFlow]:
    from tcrdata import flow_evaluation
    from tcrdata.flow_models import named_estimator
    from tcrdata.store import open_store

    if store is not None:
        yield from flow_evaluation.score_store(open_store(store))
        return
    flow, weights, model, model_store, iterations = estimator
    chosen = named_estimator(flow or "dis", weights, model, model_store, iterations)
    if dataset is not None:
        yield from flow_evaluation.score_dataset(dataset, root or "", chosen)
    else:
        yield from flow_evaluation.score_folder(root or "", chosen)


def _rows(scored: list[ScoredFlow], *, each: bool) -> list[tuple[Any, ...]]:
    """A row for each group and estimator, below its pairs; then what zeros score."""
    from tcrdata.evaluation.flow import total_score

    rows: list[tuple[Any, ...]] = []
    groups = dict.fromkeys((one.group, one.method) for one in scored)
    for group, method in groups:
        own = [one for one in scored if (one.group, one.method) == (group, method)]
        if each:
            for one in own:
                size = f"{one.width_px}x{one.height_px}"
                rows.append((one.name, group, method, size, *_numbers(one.score)))
        if len(own) > 1 or not each:
            sizes = sorted({f"{one.width_px}x{one.height_px}" for one in own})
            total = total_score(one.score for one in own)
            rows.append((f"all {len(own)}", group, method, ", ".join(sizes), *_numbers(total)))
    for group in dict.fromkeys(one.group for one in scored):
        scores = [one.score for one in scored if one.group == group]
        zeros = total_score(scores).of_zeros()
        if zeros.known:
            rows.append((f"all {len(scores)}", group, "zeros", "", *_numbers(zeros)))
    return rows


def _numbers(score: FlowScore) -> tuple[Any, ...]:
    return (
        score.known,
        score.epe_px,
        score.outlier_share,
        score.consistent_share,
        score.epe_consistent_px,
        score.epe_inconsistent_px,
        score.epe_moving_px,
    )


def _plain(one: ScoredFlow) -> dict[str, Any]:
    zeros = one.score.of_zeros()
    return {
        "group": one.group,
        "name": one.name,
        "method": one.method,
        "width_px": one.width_px,
        "height_px": one.height_px,
        "known_pixels": one.score.known,
        "epe_px": one.score.epe_px,
        "outlier_share": one.score.outlier_share,
        "consistent_share": one.score.consistent_share,
        "epe_consistent_px": one.score.epe_consistent_px,
        "epe_inconsistent_px": one.score.epe_inconsistent_px,
        "moving_pixels": one.score.moving,
        "epe_moving_px": one.score.epe_moving_px,
        "zeros": {
            "epe_px": zeros.epe_px,
            "outlier_share": zeros.outlier_share,
            "epe_moving_px": zeros.epe_moving_px,
        },
    }
