"""Rows of `tracklets` and `trajectories`, from what a tracker hands on."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcrdata.evidence.proposal_columns import box_columns
from tcrdata.evidence.stored_flow import read_flow
from tcrdata.evidence.world import World
from tcrdata.geometry.transforms import level_project
from tcrdata.tracking.library import LibrarySettings, entry_starts, normalised
from tcrdata.tracking.scenes import from_box
from tcrdata.tracking.targets import Sighting
from tcrdata.tracking.tracker import Finished
from tcrdata.types import Float32Array, FloatArray, Tables

_NEAR_M = 0.1
_SEEN_SHARE = 0.5
_FLOWS = 8
_BOX = "box"  # (7,) of a row that is not projected yet, level frame
_PROBES = np.array(
    [[u, v, w] for u in (-0.3, 0, 0.3) for v in (-0.3, 0, 0.3) for w in (-0.3, 0, 0.3)]
)


@dataclass
class _Path:
    """The last rows of one tracklet, each with how far flow is from the motion that led there."""

    rows: list[tuple[Sighting, float | None]] = field(default_factory=list)
    last: Sighting | None = None


@dataclass
class RowMaker:
    """Turns what is finished into rows; keeps of each tracklet what its next entry may need.

    Attributes:
        world: of the sequence.
        tables: of the sequence: its flows, where there are any.
        prefix: of the tracklets' ids.
        metric_scale: of the sequence.
        constant: columns of `tracklets` that are the same in every row.
        labels: frame to the rows of its candidates, in order.
        settings: how paths are cut; None for none.
    """

    world: World
    tables: Tables
    prefix: str
    metric_scale: float
    constant: Mapping[str, Any]
    labels: Mapping[int, Sequence[Mapping[str, Any]]]
    settings: LibrarySettings | None = None
    _paths: dict[int, _Path] = field(default_factory=dict)
    _flows: deque[tuple[tuple[int, int], Float32Array | None]] = field(
        default_factory=lambda: deque(maxlen=_FLOWS)
    )

    def tracklet_rows(self, finished: Finished) -> list[dict[str, Any]]:
        """Return the rows of a tracklet that are settled now, for `tracklet_columns`."""
        path = self._paths.setdefault(finished.number, _Path())
        seen = [s.frame for s in (path.last, *finished.rows) if s is not None and not unseen(s)]
        rows = []
        for sighting in finished.rows:
            row = self._row(finished, sighting, path.last)
            apart = [abs(sighting.frame - frame) for frame in seen]
            row["frames_from_sighting"] = min(apart, default=0)
            rows.append(row)
            if self.settings is not None:
                path.rows.append((sighting, self._flow_error(path.last, sighting)))
            path.last = sighting
        if finished.over and self.settings is None:
            del self._paths[finished.number]
        return rows

    def _row(
        self, finished: Finished, sighting: Sighting, before: Sighting | None
    ) -> dict[str, Any]:
        candidates = self.labels.get(sighting.frame, ())
        row = {
            "tracklet_id": f"{self.prefix}/{finished.number:05d}",
            "frame": sighting.frame,
            **self.constant,
            "found": sighting.found,
            "proposal_id": (
                candidates[sighting.candidate]["proposal_id"] if sighting.candidate >= 0 else None
            ),
            _BOX: self.world.box_to_level(sighting.frame, sighting.box),
            "visible_share": sighting.visible_share,
            "score": sighting.score,
            "number_of_points": sighting.points,
            "passable": sighting.passable,
            "speed_mps": self._speed(before, sighting),
        }
        if finished.object_id:
            row["object_id"] = finished.object_id
        return row

    def tracklet_columns(self, rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
        """Return rows of `tracklet_rows` as columns; boxes are projected a frame at a time."""
        columns = columns_of(rows)
        boxes = np.array(columns.pop(_BOX, [])).reshape(-1, 7)
        frames = np.array(columns.get("frame", []), dtype=np.int64)
        order = np.argsort(frames, kind="stable")
        placed: dict[str, list[Any]] = defaultdict(list)
        for own in np.split(order, np.flatnonzero(np.diff(frames[order])) + 1):
            if len(own):
                frame = self.world.frames[int(frames[own[0]])]
                for name, values in box_columns(boxes[own], frame).items():
                    placed[name] += values
        back = np.argsort(order, kind="stable").tolist()
        placed.pop("range_m", None)
        return columns | {name: [values[i] for i in back] for name, values in placed.items()}

    def _speed(self, before: Sighting | None, now: Sighting) -> float | None:
        if before is None or not self.world.timed:
            return None
        frames = self.world.frames
        ns = frames[now.frame].timestamp_ns - frames[before.frame].timestamp_ns
        way = now.box[[0, 2]] - before.box[[0, 2]]
        return float(np.hypot(*way)) / (ns * 1e-9) if ns > 0 else None

    def trajectory_rows(self, number: int, *, over: bool) -> Iterator[dict[str, Any]]:
        """Yield the entries that a tracklet's rows make.

        Args:
            number: of the tracklet.
            over: it has no more rows; else those that may become longer wait.
        """
        if self.settings is None or number not in self._paths:
            return
        path = self._paths[number]
        own = self.settings
        while path.rows and (over or len(path.rows) > own.most_frames):
            frames = np.array([row.frame for row, _ in path.rows])
            spans = [span for span in entry_starts(frames, own) if span[0] == 0]
            for first, last in spans:
                yield self._trajectory(number, path.rows[first:last])
            path.rows = path.rows[own.stride_frames :]
        if over:
            del self._paths[number]

    def _trajectory(
        self, number: int, steps_there: Sequence[tuple[Sighting, float | None]]
    ) -> dict[str, Any]:
        rows = [row for row, _ in steps_there]
        # What led to the first row is no step of this path.
        errors = [error for _, error in steps_there[1:] if error is not None]
        boxes = np.array([row.box for row in rows])
        steps, turns, first = normalised(boxes)
        passable = [row.passable for row in rows]
        name = f"{self.prefix}/{number:05d}"
        return {
            "trajectory_id": f"{name}/{rows[0].frame:06d}",
            "tracklet_id": name,
            "selection_id": self.constant["selection_id"],
            "frame": rows[0].frame,
            "frames": rows[-1].frame - rows[0].frame + 1,
            "metric_scale": self.metric_scale,
            "first_step_m": first,
            "travel_m": float(np.hypot(*(boxes[-1, [0, 2]] - boxes[0, [0, 2]]))),
            "passable": float(np.mean(passable)),
            "lowest_passable": float(np.min(passable)),
            "visible_share": float(np.mean([row.visible_share for row in rows])),
            "flow_error_px": float(np.median(errors)) if errors else None,
            "along_m": steps[:, 0].tolist(),
            "down_m": steps[:, 1].tolist(),
            "across_m": steps[:, 2].tolist(),
            "turn_rad": turns.tolist(),
        }

    def _flow_error(self, before: Sighting | None, now: Sighting) -> float | None:
        """Median over a box of how far flow is from its projected motion; None where unknown."""
        if before is None or min(before.visible_share, now.visible_share) < _SEEN_SHARE:
            return None
        flow = self._flow(before.frame, now.frame)
        if flow is None:
            return None
        at, to = (
            _pixels(
                self.world.box_to_level(s.frame, s.box), self.world.frames[s.frame].level_projection
            )
            for s in (before, now)
        )
        inside = np.isfinite(at).all(axis=1) & np.isfinite(to).all(axis=1)
        column, line = np.round(at[inside]).astype(int).T
        kept = (column >= 0) & (line >= 0) & (column < flow.shape[1]) & (line < flow.shape[0])
        motion = (to - at)[inside][kept]
        gaps = np.linalg.norm(flow[line[kept], column[kept]] - motion, axis=1)
        gaps = gaps[np.isfinite(gaps)]
        return float(np.median(gaps)) if len(gaps) else None

    def _flow(self, start: int, end: int) -> Float32Array | None:
        """Return a flow; the last few are kept, as many tracklets ask for the same one."""
        for pair, known in self._flows:
            if pair == (start, end):
                return known
        frames = self.world.frames
        stored = read_flow(self.tables, frames[start], frames[end])
        flow = None if stored is None else stored.decode()
        self._flows.append(((start, end), flow))
        return flow


def unseen(sighting: Sighting) -> bool:
    """Whether a box was filled in, not matched."""
    return sighting.score is None


def _pixels(box: FloatArray, projection: FloatArray | None) -> FloatArray:
    """Return the pixels of places spread over a (7,) level box; NaN where there are none."""
    places = from_box(_PROBES, box)
    if projection is None:
        return np.full((len(places), 2), np.nan)
    pixels, depth = level_project(projection, places)
    return np.where((depth > _NEAR_M)[:, None], pixels, np.nan)


def columns_of(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return rows as columns."""
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
