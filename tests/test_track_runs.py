"""Tracking a generated table through the command line: resumable, and truth stays where it is."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_runs import done, refused, run
from store_files import digests

from tcrdata.cli.track import track
from tcrdata.datasets.demo import open_dataset
from tcrdata.errors import DatasetError, EvidenceError, FrameError, SettingsError
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.settings import parse_assignments
from tcrdata.store import Store, open_store
from tcrdata.track_plans import plan_tracking
from tcrdata.tracked_scenes import scene_source
from tcrdata.types import Frame

SCENE = "seed=3,frames=6,sequences=1"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels of a preset, not tracked yet."""
    store = tmp_path_factory.mktemp("track") / "built"
    done("build", "--dataset", "demo", "--root", SCENE, "--store", store, "--preset", "tabletop",
         "--workers", 1)  # fmt: skip
    return store


@pytest.fixture(scope="module")
def tracked(built: Path) -> Path:
    """The same, tracked from labels and from truth."""
    store = built.parent / "tracked"
    shutil.copytree(built, store)
    done("track", "--store", store, "--workers", 1)
    return store


def rows(store: Path, table: str, **equals: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = open_store(str(store)).read(table, **equals).to_pylist()
    return found


def test_labels_become_tracklets_with_and_without_the_library(tracked: Path) -> None:
    labels = rows(tracked, "labels", state="positive")
    for library in (False, True):
        own = rows(tracked, "tracklets", library=library)
        assert {row["proposal_id"] for row in own} >= {row["proposal_id"] for row in labels}
        assert len({(row["tracklet_id"], row["frame"]) for row in own}) == len(own)
        assert all(0 <= row["visible_share"] <= 1 for row in own)
    assert {row["frames"] for row in rows(tracked, "trajectories")} == {6}


def test_what_was_not_begun_with_truth_has_no_overlap_over_time(tracked: Path) -> None:
    said = done("evaluate", "tracking", "--store", tracked)
    assert "no tracklet began with a true first box" in said.err
    assert "--init-from truth" in said.err
    assert "overlap after so many frames" not in said.out


def test_the_settings_that_the_help_names_exist(built: Path) -> None:
    named = re.findall(r"such as\s+(\S+=\d[\d.]*\d|\S+=\d)", str(track.__doc__))
    assert len(named) == 2
    store = open_store(str(built))
    plan = plan_tracking(store, str(store.newest_selection()), assignments=parse_assignments(named))
    assert plan.entries


def test_tracking_again_does_nothing(tracked: Path) -> None:
    before = digests(tracked)
    assert "nothing to do: all 3 units were done already" in done(
        "track", "--store", tracked, "--workers", 1
    ).err  # fmt: skip
    assert digests(tracked) == before


def test_a_tracking_that_was_killed_ends_byte_equal(tracked: Path, tmp_path: Path) -> None:
    """What is left of a killed one: files, but no record."""
    store = tmp_path / "killed"
    shutil.copytree(tracked, store)
    for name in ("tracklets_library", "tracklet_boxes"):
        (record,) = store.glob(f"commits/demo/*/{name}-*.r1.g1.json")
        record.unlink()
    done("track", "--store", store, "--workers", 1)
    assert digests(store) == digests(tracked)


def test_what_began_with_truth_reaches_no_label(built: Path, tracked: Path, tmp_path: Path) -> None:
    """Its rows lie in a table of their own that nothing that makes labels can read."""
    assert "truth_tracklets" not in EVIDENCE_TABLES
    store = tmp_path / "truth"
    shutil.copytree(built, store)
    done("track", "--store", store, "--init-from", "truth", "--library", "off", "--workers", 1)
    assert rows(store, "truth_tracklets")
    before, after = (open_store(str(s)) for s in (built, store))
    for table in ("proposals", "confidences", "tracklets", "trajectories", "labels"):
        assert after.read(table).equals(before.read(table)), table
    again = done("check", "--store", store, "--preset", "tabletop", "--json").json
    assert again["selection_id"] == before.newest_selection()


def test_tracklets_are_proposals_that_a_rule_can_take(tracked: Path) -> None:
    own = rows(tracked, "proposals", source="tracklet")
    tracklets = rows(tracked, "tracklets", library=True)
    assert len(own) == len(tracklets)
    assert {row["track_id"] for row in own} == {row["tracklet_id"] for row in tracklets}
    found = {row["proposal_id"]: row for row in rows(tracked, "confidences", module="tracklet")}
    assert found.keys() == {row["proposal_id"] for row in own}


def test_scores_and_pictures(tracked: Path, tmp_path: Path) -> None:
    store = tmp_path / "scored"
    shutil.copytree(tracked, store)
    done("track", "--store", store, "--init-from", "truth", "--library", "off", "--workers", 1)
    result = done("evaluate", "tracking", "--store", store, "--json", "--out", tmp_path / "png")
    curve = next(c for c in result.json["curves"] if c["subset"] == "all")
    assert curve["iou"][0] == pytest.approx(1.0)
    assert min(value for value in curve["iou"][:6]) > 0.6
    assert sorted(path.name for path in (tmp_path / "png").iterdir()) == [
        "overlap.png",
        "timeline_table_0000.png",
    ]
    text = done("evaluate", "tracking", "--store", store).out
    assert "from the first to the last frame" in text


def test_labelled_objects_that_no_frame_shows_are_counted(built: Path, tmp_path: Path) -> None:
    store = tmp_path / "unseen"
    shutil.copytree(built, store)
    objects = len({row["object_id"] for row in rows(store, "ground_truth")})
    said = done("track", "--store", store, "--init-from", "truth", "--library", "off",
                "--set", "least_truth_points=1000000", "--workers", 1)  # fmt: skip
    assert f"{objects} of {objects} labelled objects are not tracked from truth" in said.err
    assert not rows(store, "truth_tracklets")
    assert "where one is in view" in refused("evaluate", "tracking", "--store", store)


def test_tracklets_are_exported(tracked: Path, tmp_path: Path) -> None:
    done("export", "mot", "--tracklets", "--store", tracked, "--out", tmp_path / "mot")
    lines = (tmp_path / "mot" / "table_0000.txt").read_text().splitlines()
    assert len(lines) == len(rows(tracked, "tracklets", library=True))
    message = refused("export", "coco", "--tracklets", "--store", tracked, "--out", tmp_path / "c")
    assert "export kitti-tracking or mot" in message


def test_each_selections_tracklets_stay_and_change_no_other_selection(
    built: Path, tracked: Path, tmp_path: Path
) -> None:
    store = tmp_path / "both"
    shutil.copytree(tracked, store)
    first = str(open_store(str(built)).newest_selection())
    done("check", "--store", store, "--preset", "tabletop", "--set", "min_points=200",
         "--name", "few")  # fmt: skip
    done("track", "--store", store, "--selection", "few", "--library", "off", "--workers", 1)
    before, after = rows(tracked, "tracklets"), rows(store, "tracklets", selection_id=first)
    assert after == before
    few = rows(store, "tracklets", selection_id=str(open_store(str(store)).newest_selection("few")))
    assert few
    boxes = rows(store, "proposals", source="tracklet")
    assert len({row["proposal_id"] for row in boxes}) == len(boxes)
    for words, expected in (((), few), (("--selection", first), before)):
        out = tmp_path / str(len(words))
        done("export", "mot", "--tracklets", "--store", store, "--out", out, *words)
        lines = (out / "table_0000.txt").read_text().splitlines()
        linked = any(row["library"] for row in expected)
        assert len(lines) == sum(row["library"] == linked for row in expected)
    again = done("check", "--store", store, "--preset", "tabletop", "--json").json
    assert again["selection_id"] == first


def test_a_library_of_zero_entries_still_follows(built: Path, tmp_path: Path) -> None:
    store = tmp_path / "zero"
    shutil.copytree(built, store)
    done("track", "--store", store, "--set", "library_entries.min_passable=2", "--workers", 1)
    assert rows(store, "tracklets", library=True)


@pytest.mark.parametrize(
    "setting",
    ["library.stride_frames=0", "gates.hidden_frames=0", "gates.voxel_m=0",
     "short.update_sightings=0", "short.correlation.voxel_m=0"],
)  # fmt: skip
def test_settings_that_track_nothing_are_refused(built: Path, setting: str) -> None:
    with pytest.raises(
        SettingsError, match=rf"track\.{setting.partition('=')[0]}: (at least|above)"
    ):
        plan_tracking(
            open_store(str(built)),
            str(open_store(str(built)).newest_selection()),
            assignments=parse_assignments([setting]),
        )


@pytest.mark.parametrize(
    ("setting", "said"),
    [("min_passable=high", "a number is needed"), ("nope=1", "has no parameter 'nope'")],
)
def test_parameters_of_the_library_are_checked_before_anything_is_tracked(
    built: Path, setting: str, said: str
) -> None:
    store = open_store(str(built))
    with pytest.raises(SettingsError, match=said):
        plan_tracking(
            store,
            str(store.newest_selection()),
            assignments=parse_assignments([f"library_entries.{setting}"]),
        )


class Unreadable:
    """A dataset of which some frames can no longer be read."""

    def __init__(self, dataset: Any, lost: set[int]) -> None:
        self.dataset, self.lost = dataset, lost

    def read_points(self, frame: Frame) -> Any:
        if frame.frame in self.lost:
            raise FrameError(f"frame {frame.frame}: gone")
        return self.dataset.read_points(frame)

    def read_image(self, frame: Frame) -> Any:
        return self.dataset.read_image(frame)


def test_frames_that_cannot_be_read_any_more_are_told_and_none_at_all_is_an_error(
    built: Path,
) -> None:
    store = open_store(str(built))
    dataset = open_dataset(SCENE)
    told: list[tuple[int, str]] = []

    def scenes(lost: set[int]) -> list[int]:
        source = scene_source(store, Unreadable(dataset, lost), "demo", "table_0000", [], 1)
        return [scene.frame for scene in source.scenes(lambda *row: told.append(row))]

    assert scenes({1, 4}) == [0, 2, 3, 5]
    assert told == [(1, "frame 1: gone"), (4, "frame 4: gone")]
    with pytest.raises(EvidenceError, match="none of 6 frames can be read: frame 5: gone"):
        scenes(set(range(6)))


def test_where_every_sequence_fails_nothing_is_left_to_evaluate(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(*_: object) -> Any:
        raise DatasetError("/clips: no such folder")

    monkeypatch.setattr("tcrdata.track_runs._dataset", lost)
    said = run("track", "--store", built, "--library", "off", "--workers", 1)
    assert said.code == 1
    assert "failed: demo/table_0000 tracklets" in said.err
    assert "next:" not in said.err


def test_what_cannot_be_tracked_is_said(built: Path, tmp_path: Path) -> None:
    store = tmp_path / "empty"
    shutil.copytree(built, store)
    opened: Store = open_store(str(store))
    done("check", "--store", store, "--preset", "tabletop", "--set", "min_points=1000000",
         "--name", "empty")  # fmt: skip
    message = refused("track", "--store", store, "--selection", "empty", "--workers", 1)
    assert "has no label to track" in message
    assert opened.newest_selection("tabletop")
    assert "did you mean gates" in refused("track", "--store", store, "--selection", "tabletop",
                                           "--set", "gate.still_m=1")  # fmt: skip
    assert "to begin with" not in str(
        plan_tracking(opened, str(opened.newest_selection("tabletop")), start="truth")
    )
    message = refused("evaluate", "tracking", "--store", store, "--selection", "tabletop")
    assert "was tracked yet: run" in message
