"""The EM loop: every round beside the others, resumable, blind to labels, and watched for drift."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_runs import done, refused, run
from store_files import digests

from tcrdata import pipeline, rounds
from tcrdata.datasets import street
from tcrdata.dry_runs import dry_rounds
from tcrdata.errors import DatasetError, SettingsError
from tcrdata.outcomes import BuildReport, UnitOutcome
from tcrdata.rounds import build_rounds, plan_rounds
from tcrdata.status import store_status
from tcrdata.store import open_store

ROOT = "seed=5,speed_mps=10,frames=6"
TINY = {
    "train.steps": "4",
    "train.batch": "1",
    "train.checkpoint_steps": "2",
    "train.workers": "0",
    "train.network.cell_m": "1",
    "train.network.widths": "8,8,8",
    "train.network.head_width": "8",
    # Four steps teach little: all that is seen is a candidate.
    "objectness3d.least_score": "0.01",
    "detected_objects.least_score": "0.01",
    "objectness3d.turn_rad": "0",
}
Progress = Any


def loop(count: int, **more: Any) -> rounds.Loop:
    return plan_rounds("street", ROOT, rounds=count, assignments=TINY, **more)


def build(
    store: Path, what: int | rounds.Loop, progress: Progress = None, trained: Progress = None
) -> BuildReport:
    return build_rounds(
        loop(what) if isinstance(what, int) else what,
        str(store),
        workers=1,
        progress=progress or (lambda _: None),
        trained=trained or (lambda *_: None),
    )


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of the first round with all that the later ones read."""
    store = tmp_path_factory.mktemp("measured") / "store"
    first = loop(2).first
    report = pipeline.build(first, str(store), workers=1, progress=lambda _: None)
    assert report.selections[0].labels > 0
    return store


@pytest.fixture(scope="module")
def reference(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("reference") / "store"
    shutil.copytree(measured, store)
    report = build(store, 3)
    assert report.count("failed") == report.count("skipped") == 0
    assert [selection.round for selection in report.leading] == [1, 2, 3]
    return store


def test_every_rounds_evidence_labels_and_models_stay(reference: Path) -> None:
    connection = open_store(str(reference)).connect()
    sql = "select distinct round from {} where source = 'detector' order by 1"
    assert connection.sql(sql.format("proposals")).fetchall() == [(2,), (3,)]
    assert connection.sql("select labels_round from models order by 1").fetchall() == [(1,), (2,)]
    found = connection.sql("select round, preset from selections order by round").fetchall()
    assert found == [(1, "tcrdata"), (2, "tcrdata_learned"), (3, "tcrdata_learned")]
    # What was measured once is not measured again, and no two rounds share an id.
    assert connection.sql("select distinct round from egomotions").fetchall() == [(1,)]
    (twice,) = connection.sql(
        "select count(*) - count(distinct proposal_id) from proposals where source = 'detected'"
    ).fetchall()
    assert twice == (0,)
    own = connection.sql(
        "select count(*) from models m join selections s using (selection_id) "
        "where s.round = m.labels_round"
    ).fetchall()
    assert own == [(2,)]


def test_a_later_round_is_selected_again_with_another_bound(
    reference: Path, tmp_path: Path
) -> None:
    shutil.copytree(reference, tmp_path / "store")
    ask = ("check", "--store", tmp_path / "store", "--preset", "tcrdata_learned")
    again = done(*ask, "--round", 3, "--json").json
    (known,) = (
        open_store(str(reference))
        .connect()
        .sql("select selection_id, labels from selections where round = 3")
        .fetchall()
    )
    assert (again["selection_id"], again["labels"]) == known
    strict = done(*ask, "--round", 3, "--set", "min_points=10000", "--name", "strict", "--json")
    assert (strict.json["round"], strict.json["name"]) == (3, "strict")
    assert strict.json["selection_id"] != again["selection_id"]
    assert strict.json["labels"] < again["labels"]
    assert "round 3 has it: give --round 3" in refused(*ask)


def test_status_counts_the_units_of_all_rounds(reference: Path) -> None:
    status = store_status(open_store(str(reference)))
    assert (status.failed, status.missing) == (0, 0)
    assert [row[:2] for row in status.rounds] == [(1, 0), (2, 1), (3, 1)]


def test_a_second_build_does_nothing(reference: Path) -> None:
    before = digests(reference)
    foreseen = dry_rounds(loop(3), str(reference))
    assert foreseen.count("todo") == 0
    assert foreseen.count("done") == loop(3).units
    report = build(reference, 3)
    assert report.count("made") == 0
    assert report.count("done") == loop(3).units
    assert not any(selection.made for selection in report.selections)
    assert digests(reference) == before


@pytest.fixture(scope="module")
def planned() -> rounds.Loop:
    """Two rounds whose labels are tracked."""
    return loop(2, tracking=True)


@pytest.fixture(scope="module")
def followed(
    measured: Path, planned: rounds.Loop, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    store = tmp_path_factory.mktemp("followed") / "store"
    shutil.copytree(measured, store)
    report = build(store, planned)
    assert report.count("failed") == report.count("skipped") == 0
    return store


def test_the_next_round_learns_from_what_tracking_adds(measured: Path, followed: Path) -> None:
    connection = open_store(str(followed)).connect()
    led = "select m.labels_round, s.preset from models m join selections s using (selection_id)"
    assert connection.sql(led).fetchall() == [(1, "tcrdata_tracked")]
    chosen = connection.sql("select round, preset, selection_id from selections").fetchall()
    ids = {(number, preset): own for number, preset, own in chosen}
    assert sorted(ids) == [
        (1, "tcrdata"), (1, "tcrdata_tracked"), (2, "tcrdata_learned"),
        (2, "tcrdata_learned_tracked"),
    ]  # fmt: skip
    # Each follows its own round's labels, and what was selected before tracking is as it was.
    tracked = connection.sql("select distinct round, selection_id from tracklets").fetchall()
    assert set(tracked) == {(1, ids[1, "tcrdata"]), (2, ids[2, "tcrdata_learned"])}
    assert ids[1, "tcrdata"] == open_store(str(measured)).newest_selection()
    for number, before, after in (
        (1, "tcrdata", "tcrdata_tracked"), (2, "tcrdata_learned", "tcrdata_learned_tracked")
    ):  # fmt: skip
        kept = connection.execute(
            "select count(*) filter (source != 'tracklet') = (select count(*) from labels "
            "where state = 'positive' and selection_id = $1) from labels "
            "where state = 'positive' and selection_id = $2",
            [ids[number, before], ids[number, after]],
        ).fetchall()
        assert kept == [(True,)]


def test_a_second_build_with_tracking_does_nothing(planned: rounds.Loop, followed: Path) -> None:
    before = digests(followed)
    foreseen = dry_rounds(planned, str(followed))
    assert foreseen.count("todo") == 0
    report = build(followed, planned)
    assert report.count("made") == 0
    assert report.count("done") == foreseen.count("done") == planned.units
    assert digests(followed) == before


def test_tracking_that_was_stopped_goes_on_where_it_was(
    measured: Path, planned: rounds.Loop, followed: Path, tmp_path: Path
) -> None:
    store = tmp_path / "store"
    shutil.copytree(measured, store)

    def stop(outcome: UnitOutcome) -> None:
        if outcome.unit.stage.startswith("tracklets_library"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(store, planned, progress=stop)
    build(store, planned)
    assert digests(store) == digests(followed)


def test_a_dry_run_needs_no_store(tmp_path: Path) -> None:
    where = ("--root", ROOT, "--store", tmp_path / "none", "--rounds", 2)
    assert "objectness3d" in done("build", "--dataset", "street", *where, "--dry-run").out
    assert not (tmp_path / "none").exists()


def test_more_rounds_go_on_from_those_there_are(measured: Path) -> None:
    foreseen = dry_rounds(loop(2), str(measured))
    todo = [outcome.unit.stage for outcome in foreseen.outcomes if outcome.state == "todo"]
    assert todo == ["model", "objectness3d", "detected_objects"]


def test_ground_truth_is_out_of_reach(
    measured: Path, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With truth that cannot even be read the later rounds' rows are the same, to the byte."""

    def broken(self: Any, sequence: str) -> list[dict[str, Any]]:
        raise DatasetError("poisoned")

    monkeypatch.setattr(street.StreetDrive, "ground_truth", broken)
    shutil.copytree(measured, tmp_path / "store")
    report = build(tmp_path / "store", 2)
    assert report.count("failed") == 1
    poisoned, sound = digests(tmp_path / "store", "data"), digests(reference, "data")
    assert poisoned.items() <= sound.items()
    assert any("/r2-" in path and "labels" in path for path in poisoned)


def test_a_stopped_loop_goes_on_where_it_was(
    measured: Path, reference: Path, tmp_path: Path
) -> None:
    shutil.copytree(measured, tmp_path / "store")
    steps: list[int] = []

    def stop_training(labels_round: int, kind: str, report: Any) -> None:
        steps.append(report.step)
        if steps == [1, 2, 3]:
            raise KeyboardInterrupt

    def stop_between(outcome: UnitOutcome) -> None:
        if outcome.unit.stage == "objectness3d" and outcome.unit.round == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(tmp_path / "store", 3, trained=stop_training)
    with pytest.raises(KeyboardInterrupt):
        build(tmp_path / "store", 3, progress=stop_between, trained=stop_training)
    assert steps == [1, 2, 3, 3, 4]
    build(tmp_path / "store", 3)
    for part in ("data", "commits"):
        assert digests(tmp_path / "store", part) == digests(reference, part)


def test_build_prints_what_each_round_changed(reference: Path) -> None:
    sets = [word for pair in TINY.items() for word in ("--set", "=".join(pair))]
    command = ("build", "--dataset", "street", "--root", ROOT, "--store", reference)
    again = done(*command, "--rounds", 3, "--workers", 1, *sets)
    assert "rounds" in again.out
    assert "agreement" in again.out
    assert "nothing to do" in again.err
    found = done(*command, "--rounds", 3, "--workers", 1, *sets, "--json").json
    assert [drift["round"] for drift in found["drifts"]] == [2, 3]
    for drift, selection in zip(found["drifts"], found["selections"][1:], strict=True):
        assert drift["labels"] == selection["labels"]
        assert drift["kept"] + drift["moved"] + drift["gained"] == selection["labels"]


def test_without_torch_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    line = refused("build", "--dataset", "street", "--store", "unused", "--rounds", 2)
    assert "tcrdata[train]" in line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--rounds", 0), "at least one"),
        (("--rounds", 2, "--snapshot", "s"), "--snapshot"),
        (("--tracking", "on", "--snapshot", "s"), "--snapshot"),
        (("--rounds", 2, "--preset", "detector"), "takes a model"),
        (("--rounds", 2, "--set", "train.stepz=3"), "train.stepz"),
        (("--rounds", 2, "--set", "min_nothing=3"), "min_nothing"),
        (("--rounds", 1, "--set", "train.steps=3"), "train"),
    ],
)
def test_what_cannot_be_is_refused_before_any_work(
    words: tuple[Any, ...], message: str, tmp_path: Path
) -> None:
    store = tmp_path / "store"
    result = run("build", "--dataset", "street", "--store", store, "--workers", 1, *words)
    assert result.code != 0
    assert message in result.err
    assert not store.exists()


def test_a_preset_without_successor_makes_one_round_only(tmp_path: Path) -> None:
    path = tmp_path / "mine.sql"
    path.write_text(
        "-- Mine.\n-- rules: source, range\n-- required: source\n-- cues: tracks\n"
        "select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p\n"
    )
    with pytest.raises(SettingsError, match="next"):
        loop(2, presets=(str(path),))
    with pytest.raises(SettingsError, match="-- follows: mine"):
        loop(1, presets=(str(path),), tracking=True)


def test_the_other_presets_evidence_is_measured_too() -> None:
    """What another preset accepts is no background, so its cues are built in the first round."""
    planned = loop(2)
    assert "static_clusters" in planned.first.cues
    assert planned.later is not None
    assert planned.later.cues == ("objectness3d", "detected_objects")
    assert planned.later.presets == ("tcrdata_learned",)
    assert planned.kinds == ("detector",)


def test_each_round_calibrates_its_modules_by_one_another(reference: Path) -> None:
    """Confidences that others share more rank higher, and no row rests on truth or nobody."""
    rows = open_store(str(reference)).read("calibrations").to_pylist()
    assert {row["round"] for row in rows} == {2, 3}
    assert {"track", "free_space", "objectness_3d"} <= {row["module"] for row in rows}
    for row in rows:
        assert row["proposals"] > 0
        assert 0 <= row["others_confidence"] <= 1
    by_module: dict[tuple[int, str], list[float]] = {}
    for row in rows:
        by_module.setdefault((row["round"], row["module"]), []).append(row["calibrated"])
    assert all(values == sorted(values) for values in by_module.values())
