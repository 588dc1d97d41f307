"""Rows of `proposals` and `confidences` for refined tracks, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tcrdata.evidence.linked_clusters import Clusters
from tcrdata.evidence.proposal_columns import (
    Columns,
    box_columns,
    key_columns,
    merged,
    outline_columns,
)
from tcrdata.evidence.track_frames import BoxLook
from tcrdata.evidence.track_paths import Place, Shape, Track
from tcrdata.evidence.world import World
from tcrdata.geometry.boxes import box_corners_bev
from tcrdata.types import FloatArray, SequenceInfo

EDGE_MARGIN_M = 0.3
_CLUSTER_COLUMNS = (
    "bottom_above_ground_m",
    "top_above_ground_m",
    "core_points",
    "core_share",
    "votes_free_mean",
    "votes_static_mean",
    "free_share",
)
# How much of a track's confidence counts where two tracks claim one place.
_FOUND_WEIGHT = {"observed": 1.0, "gap": 0.5, "extended": 0.25}


@dataclass(frozen=True)
class Finished:
    """A track with its final path and places.

    Attributes:
        track: its clusters.
        shape: its refined path and size.
        places: where it is, in rising order of frames.
        looks: what each place shows.
    """

    track: Track
    shape: Shape
    places: list[Place]
    looks: list[BoxLook]


def statistics(
    finished: Finished, clusters: Clusters, world: World, info: SequenceInfo
) -> dict[str, Any]:
    """Return the columns that are the same in all rows of a track.

    Lengths are measured on the refined path between the first and the last sighting.
    """
    track, shape = finished.track, finished.shape
    first, last = int(track.frame[0]), int(track.frame[-1])
    # The first sighting's frame may have become unreadable: the path then begins later.
    path = shape.path.center[max(first - shape.first, 0) : last - shape.first + 1]
    near = [p for p in finished.places if p.trusted]
    travel = float(np.hypot(*(path[-1] - path[0])))
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    numbers = {name: values[track.rows] for name, values in clusters.numbers.items()}
    ranges = [np.hypot(*(p.box[[0, 2]] - world.sensor(p.frame)[[0, 2]])) for p in near]
    return {
        "track_id": f"{info.dataset}/{info.sequence}/track/{track.number:04d}",
        "age_frames": len(track.frame),
        "span_frames": last - first + 1,
        "travel_m": travel,
        "path_length_m": length,
        "straightness": travel / length if length > 0 else 0.0,
        "at_clip_edge": world.begins(first) or world.ends(last),
        "track_core_share": float(np.nanmedian(np.nan_to_num(numbers["core_share"]))),
        "track_box_core_share": _box_core_share(finished),
        "track_points": float(np.median(numbers["number_of_points"])),
        "track_height_m": shape.height,
        "track_range_min_m": float(min(ranges)),
        "seen_length_m": shape.path.seen_length,
        "seen_width_m": shape.path.seen_width,
        "refinement_residual_m": shape.path.residual_m,
    }


def _box_core_share(finished: Finished) -> float:
    """Return the median core share of what the boxes of the sightings hold; an empty one's is 0.

    The cluster that was seen to move may be a sliver of what its box holds: of a wall, or of a
    parked car that the own one passes closely.
    """
    pairs = zip(finished.places, finished.looks, strict=True)
    shares = [look.measured["core_share"] for place, look in pairs if place.found == "observed"]
    return float(np.median([share or 0.0 for share in shares]))


def confidence(columns: dict[str, Any], metric_scale: float) -> float:
    """Return how track-like a track is, in [0, 1].

    straightness * (1 - 2^(-age / 4 frames)) * (1 - 2^(-travel / 1.5 m)): half at four sightings
    and half at 1.5 m of travel, the ages and lengths at which a track starts to be believed.
    """
    age = 1 - 2.0 ** (-columns["age_frames"] / 4)
    travel = 1 - 2.0 ** (-columns["travel_m"] / (1.5 * metric_scale))
    return float(columns["straightness"] * age * travel)


def _rank(place: Place, columns: dict[str, Any], metric_scale: float) -> float:
    """Return by how much a track claims a place where two meet; 0 far beyond its ends.

    Two sightings lie on a line whatever they are: such a track's straightness claims nothing.
    """
    claims = place.trusted and columns["age_frames"] > 2
    return confidence(columns, metric_scale) * _FOUND_WEIGHT[place.found] * claims


def frame_columns(
    frame: int,
    entries: list[tuple[Finished, int, dict[str, Any]]],
    clusters: Clusters,
    world: World,
    info: SequenceInfo,
) -> Columns:
    """Return one frame's rows of `proposals`.

    Args:
        frame: frame number.
        entries: (track, number of the place, statistics), in order of track numbers.
        clusters: what the tracks link.
        world: poses and clock.
        info: of the sequence.
    """
    boxes = [f.shape.box(frame) for f, _, _ in entries]
    level = np.array([world.box_to_level(frame, box) for box in boxes])
    places = [f.places[i] for f, i, _ in entries]
    looks = [f.looks[i] for f, i, _ in entries]
    numbers = [f.track.number for f, _, _ in entries]
    points_xz = [look.xyz[:, [0, 2]] for look in looks]
    ranks = [
        _rank(place, stats, info.metric_scale)
        for place, (_, _, stats) in zip(places, entries, strict=True)
    ]
    own: Columns = {name: [stats[name] for _, _, stats in entries] for name in entries[0][2]}
    own["found"] = [place.found for place in places]
    own["speed_mps"] = [_speed(f.shape, frame, world) for f, _, _ in entries]
    own["frames_from_observation"] = [
        int(np.abs(f.track.frame - frame).min()) for f, _, _ in entries
    ]
    own["overlapped_share"] = overlapped_shares(np.array(boxes), np.array(ranks))
    measured = [_measured(p, k, clusters) for p, k in zip(places, looks, strict=True)]
    return merged(
        key_columns(world.frames[frame], "track", "track", numbers, info.metric_scale),
        box_columns(level, world.frames[frame]),
        outline_columns(level, points_xz, EDGE_MARGIN_M * info.metric_scale),
        {name: [m[name] for m in measured] for name in measured[0]},
        own,
    )


def _measured(place: Place, look: BoxLook, clusters: Clusters) -> dict[str, Any]:
    """Return the columns of one row's points: of its cluster, else of the box."""
    empty = dict.fromkeys(_CLUSTER_COLUMNS)
    if place.row < 0:
        return {
            **empty,
            **look.measured,
            "number_of_points": look.points_inside,
            "point_indices": None,
        }
    values = {
        name: None
        if np.isnan(clusters.numbers[name][place.row])
        else float(clusters.numbers[name][place.row])
        for name in _CLUSTER_COLUMNS
    }
    if values["core_points"] is not None:
        values["core_points"] = int(values["core_points"])
    return {
        **look.measured,
        **values,
        "number_of_points": int(clusters.numbers["number_of_points"][place.row]),
        "point_indices": clusters.indices[place.row].tolist(),
    }


def _speed(shape: Shape, frame: int, world: World) -> float | None:
    center = shape.path.center
    step = min(max(frame - shape.first, 0), len(center) - 1)
    before, after = max(step - 1, 0), min(step + 1, len(center) - 1)
    if after == before or not world.timed:
        return None
    distance = float(np.hypot(*(center[after] - center[before])))
    return distance / ((after - before) * world.interval_s)


def overlapped_shares(boxes: FloatArray, ranks: FloatArray) -> list[float]:
    """Return for each of (N, 7) boxes the largest share that a higher-ranked one covers."""
    import shapely

    polygons = shapely.polygons(box_corners_bev(boxes))
    shared = shapely.area(shapely.intersection(polygons[:, None], polygons[None]))
    area = np.maximum(boxes[:, 3] * boxes[:, 4], 1e-9)
    # Of equals, the track seen first ranks higher.
    order = np.lexsort((-np.arange(len(ranks)), ranks))
    place = np.empty(len(ranks), dtype=np.int64)
    place[order] = np.arange(len(ranks))
    higher = place[None] > place[:, None]
    shares = np.where(higher, shared / area[:, None], 0.0).max(axis=1, initial=0.0)
    return [float(share) for share in np.minimum(shares, 1.0)]


def confidence_columns(columns: Columns) -> list[Columns]:
    """Return the rows of `confidences` that follow from rows of `proposals`: two modules."""
    count = len(columns["proposal_id"])
    keys = {name: columns[name] for name in ("proposal_id", "frame", "source")}
    fields = ("straightness", "age_frames", "travel_m")
    tracks = [
        confidence({name: columns[name][i] for name in fields}, columns["metric_scale"][i])
        for i in range(count)
    ]
    shares = columns["track_core_share"]
    return [
        {
            **keys,
            "module": ["free_space"] * count,
            "confidence": shares,
            "raw_value": shares,
            "unit": ["share of core points"] * count,
        },
        {
            **keys,
            "module": ["track"] * count,
            "confidence": tracks,
            "raw_value": columns["travel_m"],
            "unit": ["m"] * count,
        },
    ]
