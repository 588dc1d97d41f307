"""Selections: what they decide, what they are named by, what they may read."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rule_worlds import GOOD_TRACK, PROPOSAL, put, put_tracks

import tcrdata
from tcrdata.errors import MissingEvidenceError, RuleError, StoreError
from tcrdata.rules import label_parts, load_preset, select, selection_rows
from tcrdata.rules.binding import EVIDENCE_TABLES
from tcrdata.store import Store, Unit

Write = Callable[[str, str], Path]
RULE = (
    "-- Mine.\n-- source: me\n-- needs: true\n-- cues:\n"
    "select p.proposal_id, 1::double as value, 2::double as bound, {passed} as passed\n"
    "from proposals p{joined}\n"
)
PRESET = (
    "-- Mine.\n-- rules: mine\n-- required:\n-- cues: tracks\n"
    "select p.proposal_id, {state} as state, {score}::double as score from proposals p{joined}\n"
)


def ids(store: Store, selection_id: str, state: str = "positive") -> list[str]:
    rows = store.read("labels").to_pylist()
    kept = [row for row in rows if (row["selection_id"], row["state"]) == (selection_id, state)]
    return [row["proposal_id"] for row in kept]


def own(write_sql: Write, *, passed: str = "true", **preset: str) -> str:
    write_sql("rules/mine.sql", RULE.format(passed=passed, joined=preset.get("rule_join", "")))
    text = PRESET.format(
        state=preset.get("state", "'positive'"),
        score=preset.get("score", "0.5"),
        joined=preset.get("joined", ""),
    )
    return str(write_sql("my.sql", text))


def random_tracks(count: int, seed: int) -> list[dict[str, Any]]:
    draw = random.Random(seed)
    return [
        {
            "frame": number // 4,
            "age_frames": draw.randint(3, 12),
            "travel_m": draw.uniform(0, 4),
            "straightness": draw.choice([0.4, 0.55, 0.9, 0.9, None]),
            "at_clip_edge": draw.random() < 0.3,
            "track_core_share": draw.choice([0.4, 0.5, 0.9, 0.9, None]),
            "overlapped_share": draw.choice([0.0, 0.1, 0.5, None]),
            "frames_from_observation": draw.choice([0, 0, 0, 5, 6]),
            "found": draw.choice(["observed", "gap", "extended"]),
            "number_of_points": draw.choice([5, 12, 30]),
            "range_m": draw.choice([4.0, 9.0, 9.0]),
            "source": draw.choice(["track"] * 4 + ["static"]),
        }
        for number in range(count)
    ]


def test_labels_carry_what_was_measured_and_which_rules_passed_them(store: Store) -> None:
    put_tracks(store, "a", [GOOD_TRACK, {**GOOD_TRACK, "travel_m": 0.5}])
    made = select(store, "tcrdata")
    assert (made.proposals_judged, made.labels, made.made) == (2, 1, True)
    (label,) = store.read("labels").to_pylist()
    assert (label["proposal_id"], label["state"], label["score"]) == (
        "d/a/000000",
        "positive",
        0.75,
    )
    assert (label["dataset"], label["sequence"], label["length_m"]) == ("d", "a", 4.0)
    assert label["carried_by"] == [
        "source", "travels", "core_share", "enough_points", "height", "range", "not_overlapped",
        "near_observation", "cycle_error", "alignment",
    ]  # fmt: skip  # extended_points abstained
    (row,) = store.read("selections").to_pylist()
    assert row["selection_id"] == made.selection_id == store.newest_selection("tcrdata")
    assert dict(row["parameters"])["min_travel_m"] == "3"
    assert row["required"][row["rules"].index("source")] is True


def test_judging_survivors_equals_the_definition(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selection_rows, "BATCH_ROWS", 100)
    for sequence, seed in (("a", 1), ("b", 2), ("c", 3)):
        put_tracks(store, sequence, random_tracks(80, seed))
    made = select(store, "tcrdata")
    with_checks = tcrdata.open(store.url)
    expected = with_checks.sql(
        "select proposal_id from checks group by proposal_id having "
        "not bool_or(passed is false or (passed is null and rule = 'source')) order by 1"
    ).fetchall()
    assert 5 < made.labels < 200
    assert sorted(ids(store, made.selection_id)) == [row[0] for row in expected]
    carried = with_checks.sql(
        "select count(*) from labels l join checks c using (selection_id, proposal_id) "
        "where l.state = 'positive' and "
        "c.passed is distinct from nullif(list_contains(l.carried_by, c.rule), false)"
    ).fetchall()
    assert carried == [(0,)]


def test_what_looser_bounds_accept_is_left_undecided(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The alternatives are judged in one pass; each says what it would say alone."""
    monkeypatch.setattr(selection_rows, "BATCH_ROWS", 100)
    for sequence, seed in (("a", 1), ("b", 2), ("c", 3)):
        rows = [{**row, "x_m": 9.0 * n} for n, row in enumerate(random_tracks(80, seed))]
        put_tracks(store, sequence, rows)
    made = select(store, "tcrdata")
    looser = select(store, "tcrdata", load_preset("tcrdata").loosened, name="looser")
    accepted = ids(store, made.selection_id)
    undecided = ids(store, made.selection_id, "ignore")
    assert 5 < len(undecided) == made.ignored
    assert sorted([*accepted, *undecided]) == sorted(ids(store, looser.selection_id))
    because = store.read("labels", columns=["selection_id", "state", "ignored_because"])
    assert set(map(tuple, (row.values() for row in because.to_pylist()))) == {
        (made.selection_id, "positive", None),
        (made.selection_id, "ignore", "loosened"),
        (looser.selection_id, "positive", None),
    }


def test_what_another_preset_accepts_is_left_undecided_but_not_under_a_label(store: Store) -> None:
    parked = {
        "source": "static",
        "fit": "l_shape",
        "edge_share": 0.8,
        "width_m": 1.8,
        "age_frames": 9,
        "track_core_share": 0.0,
    }
    put_tracks(store, "a", [GOOD_TRACK, {**parked, "x_m": 1.0}, {**parked, "z_m": 20.0}])
    alone = select(store, "tcrdata")
    assert ids(store, alone.selection_id, "ignore") == []  # nobody measured what stands still
    put(store, "static_clusters", "a", {})
    made = select(store, "tcrdata")
    assert ids(store, made.selection_id) == ["d/a/000000"]
    (row,) = [row for row in store.read("labels").to_pylist() if row["state"] == "ignore"]
    assert (row["proposal_id"], row["ignored_because"]) == ("d/a/000002", "tcrdata_static")
    assert "static_length" in row["carried_by"]


def test_rows_are_sorted_and_the_same_however_they_are_batched(monkeypatch: Any) -> None:
    from tcrdata.store import open_store

    found = []
    for number, (size, part) in enumerate(((1, 10**6), (10**6, 10**6), (10**6, 1))):
        monkeypatch.setattr(selection_rows, "BATCH_ROWS", size)
        monkeypatch.setattr(label_parts, "_PART_ROWS", part)
        store = open_store(f"memory://batches-{number}", create=True)
        for sequence in ("b", "a", "c"):
            put_tracks(store, sequence, random_tracks(40, 5))
        made = select(store, "tcrdata")
        found.append([entry.sha256 for entry in store.files("labels")])
        order = ids(store, made.selection_id)
        assert order == sorted(order)
    assert found[0] == found[1] == found[2]


def test_same_identity_is_pointed_to_and_not_recomputed(store: Store, monkeypatch: Any) -> None:
    put_tracks(store, "a", [GOOD_TRACK])
    first = select(store, "tcrdata")
    monkeypatch.setattr(selection_rows, "judge", None)
    again = select(store, "tcrdata", {"min_travel_m": "3.00"}, name="mine")
    assert (again.selection_id, again.made, again.labels) == (first.selection_id, False, 1)
    assert store.newest_selection("mine") == first.selection_id


def test_parameters_rule_texts_and_evidence_make_the_identity(
    store: Store, write_sql: Write
) -> None:
    put_tracks(store, "a", [GOOD_TRACK])
    seen = [
        select(store, "tcrdata").selection_id,
        select(store, "tcrdata", {"min_travel_long_m": 6}).selection_id,
        select(store, own(write_sql)).selection_id,
        select(store, own(write_sql, passed="p.range_m > 0")).selection_id,
    ]
    put_tracks(store, "b", [GOOD_TRACK])
    seen.append(select(store, "tcrdata").selection_id)
    assert len(set(seen)) == len(seen)
    assert [entry["labels"] for entry in store.read("selections").to_pylist()].count(0) == 1


def test_a_snapshot_is_judged_as_it_was(store: Store) -> None:
    put_tracks(store, "a", [GOOD_TRACK])
    store.freeze("early", list(EVIDENCE_TABLES))
    early = select(store, "tcrdata")
    put_tracks(store, "b", [GOOD_TRACK])
    assert select(store, "tcrdata", snapshot="early").selection_id == early.selection_id
    assert select(store, "tcrdata").labels == 2
    counts = tcrdata.open(store.url).sql(
        "select selection_id, count(*) from checks where rule = 'range' group by all"
    )
    assert dict(counts.fetchall())[early.selection_id] == 1
    with pytest.raises(StoreError, match="nothing"):
        select(store, "tcrdata", snapshot="nothing")


def test_static_boxes_under_a_track_give_way(store: Store) -> None:
    static = {
        "source": "static",
        "fit": "l_shape",
        "edge_share": 0.8,
        "width_m": 1.8,
        "age_frames": 9,
        "track_core_share": 0.0,
    }
    rows = [
        {**GOOD_TRACK, "yaw_rad": 0.3},
        {**static, "x_m": 1.5},
        {**static, "z_m": 13.0},
        {**static, "frame": 1},
        {**static, "z_m": 20.0, "edge_share": 0.4},
    ]
    put_tracks(store, "a", rows)
    put(store, "static_clusters", "a", {})
    made = select(store, "tcrdata_static")
    assert ids(store, made.selection_id) == ["d/a/000000", "d/a/000002", "d/a/000003"]


def test_missing_evidence_names_the_cue_and_the_build(store: Store) -> None:
    with pytest.raises(MissingEvidenceError, match="no evidence of round 1; run `tcrdata build"):
        select(store, "tcrdata")
    put_tracks(store, "a", [GOOD_TRACK])
    with pytest.raises(MissingEvidenceError) as caught:
        select(store, "release")
    assert "reads flow_ransac, regions_release, which d/a lacks" in str(caught.value)
    assert f"--root ROOT --store {store.url} --sequences a --preset release`" in str(caught.value)
    select(store, "tcrdata")
    put(store, "frames", "b", {})
    with pytest.raises(MissingEvidenceError, match="odometry, tracks, which d/b lacks"):
        select(store, "tcrdata")


def test_truth_labels_and_scores_are_never_evidence() -> None:
    assert not {"ground_truth", "labels", "metrics", "selections", "checks"} & set(EVIDENCE_TABLES)
    for name in ("paper", "release", "tcrdata", "tcrdata_static"):
        preset = load_preset(name).fill()
        tables = {t for part in (*preset.rules, preset) for t in part.reads.tables}  # type: ignore[attr-defined]
        assert tables <= set(EVIDENCE_TABLES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rule_join": ", range(2)"}, "rule mine gives 4 rows for 2 proposals"),
        ({"rule_join": ", range(2)", "passed": "p.frame = 0"}, "rule mine gives 4 rows"),
        ({"rule_join": " where p.frame > 0"}, "rule mine gives 0 rows for 2 proposals"),
        ({"passed": "cast(p.source as integer) > 0"}, "rule mine fails on the rows: Conversion"),
        ({"state": "'maybe'"}, "gives a state that is neither positive nor ignore: d/a/000000"),
        ({"score": "p.range_m"}, "gives a score outside 0 to 1: d/a/000000"),
        ({"score": "null"}, "gives a score outside 0 to 1"),
        ({"joined": ", range(2)"}, "gives a proposal twice: d/a/000000"),
    ],
)
def test_what_only_rows_can_show_is_refused(
    store: Store, write_sql: Write, change: dict[str, str], message: str
) -> None:
    put_tracks(store, "a", [GOOD_TRACK, GOOD_TRACK])
    with pytest.raises(RuleError) as caught:
        select(store, own(write_sql, **change))
    assert message in str(caught.value)
    assert store.newest_selection() is None
    assert not store.files("labels")


def test_a_frame_twice_does_not_make_up_for_one_that_is_missing(
    store: Store, write_sql: Write
) -> None:
    put_tracks(store, "a", [GOOD_TRACK, {**GOOD_TRACK, "frame": 1}])
    twice = " join (select unnest([1, 1]) as number) n on n.number = p.frame"
    with pytest.raises(RuleError, match="rule mine: some frames come twice and others never"):
        select(store, own(write_sql, rule_join=twice))


def test_names_with_a_quote_in_them_are_names(store: Store, write_sql: Write) -> None:
    put_tracks(store, "a", [GOOD_TRACK, {**GOOD_TRACK, "z_m": 50.0}])
    everything = own(write_sql)
    write_sql("rules/o'mine.sql", RULE.format(passed="p.z_m < 40", joined=""))
    text = Path(everything).read_text(encoding="utf-8").replace("rules: mine", "rules: o'mine")
    ignoring = "-- cues: tracks\n-- ignore: my\n"
    path = write_sql("o'hara.sql", text.replace("-- cues: tracks\n", ignoring))
    made = select(store, str(path))
    (label,) = (r for r in store.read("labels").to_pylist() if r["state"] == "positive")
    assert (made.name, label["carried_by"]) == ("o'hara", ["o'mine"])


def test_a_rule_may_read_what_modules_say(store: Store, write_sql: Write) -> None:
    put_tracks(store, "a", [GOOD_TRACK, GOOD_TRACK])
    path = own(
        write_sql,
        passed="c.confidence > 0.5 and p.proposal_id like '%1'",
        rule_join=" left join confidences c using (proposal_id)",
    )
    made = select(store, path)
    assert ids(store, made.selection_id) == ["d/a/000001"]


def test_a_rule_about_frames_says_the_same_of_all_their_proposals(
    store: Store, write_sql: Write
) -> None:
    put_tracks(store, "a", [GOOD_TRACK, GOOD_TRACK, {**GOOD_TRACK, "frame": 1}])
    path = own(write_sql, passed="p.frame = 0", rule_join=" left join range(1) r(i) on i = frame")
    assert ids(store, select(store, path).selection_id) == ["d/a/000000", "d/a/000001"]


def test_no_proposals_make_an_empty_selection(store: Store) -> None:
    put(store, "tracks", "a", {})
    put(store, "odometry", "a", {})
    made = select(store, "tcrdata")
    assert (made.proposals_judged, made.labels) == (0, 0)
    assert store.newest_selection() == made.selection_id


def test_a_later_round_reads_what_was_measured_once_and_its_own_models(store: Store) -> None:
    put_tracks(store, "a", [GOOD_TRACK])
    first = select(store, "tcrdata")
    for number in (2, 3):
        seen = {**PROPOSAL, **GOOD_TRACK, "z_m": 10.0 * number}
        seen["proposal_id"] = f"d/a/seen-{number}"
        rows = {n: [v] for n, v in seen.items() if n not in ("dataset", "sequence", "round")}
        with store.writer(Unit("net", "d", "a", number), settings_hash="x", inputs={}) as writer:
            writer.append("proposals", rows)
    made = select(store, "tcrdata", round=3)
    assert ids(store, made.selection_id) == ["d/a/000000", "d/a/seen-3"]
    assert ids(store, first.selection_id) == ["d/a/000000"]
    (label, _) = [row for row in store.read("labels").to_pylist() if row["round"] == 3]
    assert label["proposal_id"] == "d/a/000000"
    judged = tcrdata.open(store.url).sql(
        f"select bool_and(passed) from checks where selection_id = '{made.selection_id}' "
        "and rule = 'cycle_error'"
    )
    assert judged.fetchall() == [(True,)]  # egomotion of round 1 serves proposals of round 3
