"""The one-frame clusters that tracks link: proposals of source free_space, one fit a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcrdata.evidence.linking import Detections, LinkingSettings, link
from tcrdata.evidence.world import World
from tcrdata.types import FloatArray, IntArray, Tables

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
    chosen, seen = [], set()
    for i in order:
        if keys["region_id"][i] not in seen and keys["frame"][i] in world.frames:
            seen.add(keys["region_id"][i])
            chosen.append(i)
    table = table.take(np.array(chosen, dtype=np.int64))
    numbers = {
        name: np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)
        for name in _NUMBERS
    }
    frame = np.array([keys["frame"][i] for i in chosen], dtype=np.int64)
    center = np.stack([numbers["x_m"], numbers["y_m"], numbers["z_m"]], axis=1)
    moved = [world.point_to_world(f, c) for f, c in zip(frame.tolist(), center, strict=True)]
    return Clusters(
        frame=frame,
        numbers=numbers,
        indices=tuple(
            np.asarray(row if row is not None else [], dtype=np.int64)
            for row in (
                cell.values.to_numpy() if cell.is_valid else None for cell in table["point_indices"]
            )
        ),
        world=np.array(moved).reshape(-1, 3),
    )


def link_clusters(
    clusters: Clusters, world: World, settings: LinkingSettings, metric_scale: float
) -> list[IntArray]:
    """Return the tracks: arrays of cluster numbers, in order of first sighting.

    Frames without a common world are linked apart.
    """
    segments = np.array([world.poses.segment[f] for f in clusters.frame.tolist()], dtype=np.int64)
    tracks: list[IntArray] = []
    for segment in np.unique(segments):
        rows = np.flatnonzero(segments == segment)
        detections = Detections(
            frame=clusters.frame[rows],
            position=clusters.world[rows][:, [0, 2]],
            size_m=np.hypot(clusters.numbers["length_m"][rows], clusters.numbers["width_m"][rows]),
            core_share=np.nan_to_num(clusters.numbers["core_share"][rows]),
            usable=np.array([f for f in world.frames if world.poses.segment[f] == segment]),
        )
        labels = link(detections, settings, metric_scale)
        tracks += [rows[labels == number] for number in range(labels.max(initial=-1) + 1)]
    return tracks
