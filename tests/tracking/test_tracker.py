"""Objects behind walls and inside others, lost and found again, on exactly cast blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from block_world import block, passing, scene

from tcrdata.geometry.boxes import bev_iou
from tcrdata.tracking import short_range as short_range_module
from tcrdata.tracking.known_fits import KnownFits
from tcrdata.tracking.library import Library, basic_library, cut
from tcrdata.tracking.short_range import ShortRangeSettings, short_range
from tcrdata.tracking.targets import Sighting
from tcrdata.tracking.tracker import Tracker, TrackerSettings

EMPTY = cut(basic_library(1, 0.0), 1)
EMPTY = Library(EMPTY.steps[:0], EMPTY.turns[:0], EMPTY.speeds[:0])
World = Callable[[int], Mapping[str, np.ndarray]]


def followed(
    world: World,
    frames: list[int],
    found: tuple[str, ...],
    library: Library | None,
    tracker: str = "auto",
    starts: Any = None,
    known: KnownFits | None = None,
) -> dict[int, list[Sighting]]:
    """Number of each tracklet to its rows."""
    own = Tracker(
        short_range(tracker, ShortRangeSettings(), known), library, TrackerSettings(), starts=starts
    )
    rows: dict[int, list[Sighting]] = {}
    for frame in frames:
        for part in own.step(scene(frame, world(frame), found)):
            rows.setdefault(part.number, []).extend(part.rows)
    for part in own.finish():
        rows.setdefault(part.number, []).extend(part.rows)
    return rows


def overlaps(rows: list[Sighting], world: World, name: str) -> np.ndarray:
    return np.array([bev_iou(r.box[None], world(r.frame)[name][None])[0, 0] for r in rows])


def test_what_passes_behind_a_wall_is_one_tracklet_with_a_library_even_of_zero_entries() -> None:
    rows = followed(passing, list(range(36)), ("mover",), EMPTY)
    assert [row.frame for row in rows[0]] == list(range(36))
    assert len(rows) == 1
    hidden = [row for row in rows[0] if row.found == "library"]
    assert len(hidden) >= 6
    assert all(row.visible_share < 0.5 and row.score is None for row in hidden)
    assert overlaps(rows[0], passing, "mover").min() > 0.8


def test_without_a_library_it_is_two() -> None:
    rows = followed(passing, list(range(36)), ("mover",), None)
    assert len(rows) == 2
    assert {row.found for own in rows.values() for row in own} == {"nearest"}


def test_a_library_is_no_licence_to_jump_to_what_stands_elsewhere() -> None:
    """What went out of sight behind the wall cannot be the block that came from nowhere."""

    def world(frame: int) -> dict[str, np.ndarray]:
        boxes = passing(min(frame, 16))
        if frame >= 20:
            boxes["other"] = block(4.0, 14.0)
        return boxes

    rows = followed(world, list(range(26)), ("mover", "other"), EMPTY)
    assert len(rows) == 2
    assert rows[1][0].frame == 20


def test_what_is_covered_rides_with_its_container_and_is_marked() -> None:
    def world(frame: int) -> dict[str, np.ndarray]:
        cover = block(0.0, 8.0, (2.0, 2.0, 2.0))
        cover[1] -= max(0.0, 3.0 - frame)  # comes down in four frames, then slides
        cover[0] += 0.2 * max(0, frame - 6)
        small = block(0.2 * max(0, frame - 6), 8.0, (0.6, 0.6, 0.6))
        return {"cover": cover, "small": small}

    rows = followed(world, list(range(20)), ("cover", "small"), EMPTY)
    ridden = [row for own in rows.values() for row in own if row.found == "container"]
    assert len(ridden) >= 10
    assert overlaps(ridden, world, "small").min() > 0.7


@pytest.mark.parametrize("tracker", ["nearest", "auto"])
def test_frames_missing_in_the_middle_do_not_end_a_tracklet(tracker: str) -> None:
    frames = [0, 1, 2, 3, 6, 7, 8]
    rows = followed(passing, frames, ("mover", "still"), None, tracker)
    assert [[row.frame for row in own] for own in rows.values()] == [frames, frames]


@pytest.mark.parametrize("library", [None, EMPTY])
def test_what_is_gone_after_missing_frames_ends(library: Library | None) -> None:
    """More frames are missing than anything is waited for."""
    missing = max(TrackerSettings().misses_frames, TrackerSettings().hidden_frames) + 5
    frames = [0, 1, 2, missing, missing + 1]

    def world(frame: int) -> dict[str, np.ndarray]:
        return passing(0) if frame < missing else {"still": passing(0)["still"]}

    rows = followed(world, frames, ("mover", "still"), library)
    assert [row.frame for row in rows[0]] == [0, 1, 2]
    assert [row.frame for row in rows[1]] == frames


def test_an_object_of_one_frame_is_a_tracklet_of_one_row() -> None:
    def world(frame: int) -> dict[str, np.ndarray]:
        return {"flash": block(0.0, 10.0)} if frame == 2 else {}

    rows = followed(world, list(range(8)), ("flash",), EMPTY)
    assert [(row.frame, row.found) for row in rows[0] if row.found == "nearest"] == [(2, "nearest")]


def test_correlation_alone_follows_what_stands_and_what_moves_from_a_true_box() -> None:
    starts = {0: [(name, passing(0)[name]) for name in ("mover", "still")]}
    rows = followed(passing, list(range(10)), (), None, "correlation", starts)
    assert {row.found for row in rows[0][1:]} == {"correlation"}
    assert overlaps(rows[0], passing, "mover").min() > 0.6
    assert overlaps(rows[1], passing, "still").min() > 0.95


def test_the_same_frames_give_the_same_rows() -> None:
    first, second = (followed(passing, list(range(20)), ("mover",), EMPTY) for _ in range(2))
    for a, b in zip(first[0], second[0], strict=True):
        assert a.frame == b.frame
        np.testing.assert_array_equal(a.box, b.box)


def test_rows_are_handed_on_as_they_settle() -> None:
    """Memory holds the rows of young tracklets alone, however long a sequence is."""
    own = Tracker(short_range("nearest", ShortRangeSettings()), None, TrackerSettings())
    waiting = 0
    for frame in range(30):
        given = sum(
            len(part.rows) for part in own.step(scene(frame, passing(0), ("mover", "still")))
        )
        waiting += 2 - given
        assert waiting <= 2 * TrackerSettings().young_frames


def test_fits_that_a_pass_left_spare_the_next_one_the_search_and_change_no_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, anew = list(range(14)), []
    find = short_range_module.correlate
    monkeypatch.setattr(
        short_range_module, "correlate", lambda *given: anew.append(1) or find(*given)
    )
    plain = followed(passing, frames, ("mover", "wall"), EMPTY)
    asked, file = len(anew), tmp_path / "fits"
    anew.clear()
    for left in (asked, 0, 1):
        with KnownFits(file) as known:
            assert repr(followed(passing, frames, ("mover", "wall"), EMPTY, known=known)) == repr(
                plain
            )
        assert len(anew) == left
        anew.clear()
        # The last row torn, as a pass that was stopped leaves it: that fit is looked for again.
        file.write_bytes(file.read_bytes()[: -1 if left == 0 else None])
