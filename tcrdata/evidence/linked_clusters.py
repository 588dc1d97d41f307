"""The one-frame clusters that tracks link: proposals of source free_space, one fit a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.evidence.linking import Detections, LinkingSettings, link
from tcrdata.evidence.world import World
from tcrdata.store.table_arrays import index_lists, numbers
from tcrdata.types import CueInput, FloatArray, IntArray, Tables

_NUMBERS = (
    "x_m",
    "y_m",
    "z_m",
    "length_m",
    "width_m",
    "height_m",
    "bottom_above_ground_m",
    "top_above_ground_m",
    "number_of_points",
    "core_points",
    "core_share",
    "votes_free_mean",
    "votes_static_mean",
    "free_share",
)


@dataclass(frozen=True)
class Clusters:
    """N clusters, sorted by frame and region.

    Attributes:
        frame: (N,) frame numbers.
        numbers: columns of `proposals`, (N,) each, NaN for NULL.
        indices: N arrays of point indices.
        world: (N, 3) centres of the boxes in the world.
    """

    frame: IntArray
    numbers: dict[str, FloatArray]
    indices: tuple[IntArray, ...]
    world: FloatArray


def read_clusters(tables: Tables, world: World) -> Clusters:
    """Return the clusters of the frames that have a pose; the first fit by name of each region."""
    columns = ["frame", "region_id", "fit", "point_indices", *_NUMBERS]
    table = tables.read("proposals", columns=columns, source="free_space")
    keys = table.select(["frame", "region_id", "fit"]).to_pydict()
    order = sorted(
        range(len(keys["frame"])),
        key=lambda i: (keys["frame"][i], keys["region_id"][i], keys["fit"][i]),
    )
    chosen: list[int] = []
    seen: set[str] = set()
    for i in order:
        if keys["region_id"][i] not in seen and keys["frame"][i] in world.frames:
            seen.add(keys["region_id"][i])
            chosen.append(i)
    found = {name: numbers(table[name])[chosen] for name in _NUMBERS}
    indices = index_lists(table["point_indices"])
    frame = np.array([keys["frame"][i] for i in chosen], dtype=np.int64)
    center = np.stack([found["x_m"], found["y_m"], found["z_m"]], axis=1)
    moved = [world.point_to_world(f, c) for f, c in zip(frame.tolist(), center, strict=True)]
    return Clusters(
        frame=frame,
        numbers=found,
        indices=tuple(indices[i] for i in chosen),
        world=np.array(moved).reshape(-1, 3),
    )


@dataclass(frozen=True)
class LinkTask:
    """The clusters of the frames that share a world, for one worker; see `link`."""

    detections: Detections
    settings: LinkingSettings
    metric_scale: float


def link_task(task: LinkTask) -> IntArray:
    """Return the track number of each cluster."""
    return link(task.detections, task.settings, task.metric_scale)


def link_clusters(
    cue: CueInput, clusters: Clusters, world: World, settings: LinkingSettings
) -> list[IntArray]:
    """Return the tracks: arrays of cluster numbers, in order of first sighting.

    Frames without a common world are linked apart.
    """
    segments = np.array([world.poses.segment[f] for f in clusters.frame.tolist()], dtype=np.int64)
    parts = [np.flatnonzero(segments == segment) for segment in np.unique(segments)]
    scale = cue.info.metric_scale
    tasks = (LinkTask(_detections(clusters, world, rows), settings, scale) for rows in parts)
    tracks: list[IntArray] = []
    for rows, labels in zip(parts, cue.parallel(link_task, tasks), strict=True):
        tracks += [rows[labels == number] for number in range(labels.max(initial=-1) + 1)]
    return tracks


def _detections(clusters: Clusters, world: World, rows: IntArray) -> Detections:
    """Return some clusters of one segment as what is linked."""
    segment = world.poses.segment[int(clusters.frame[rows[0]])]
    return Detections(
        frame=clusters.frame[rows],
        position=clusters.world[rows][:, [0, 2]],
        size_m=np.hypot(clusters.numbers["length_m"][rows], clusters.numbers["width_m"][rows]),
        core_share=np.nan_to_num(clusters.numbers["core_share"][rows]),
        usable=np.array([f for f in world.frames if world.poses.segment[f] == segment]),
    )
