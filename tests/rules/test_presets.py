"""Presets: what they list fits together; overrides are checked by name and type."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tcrdata.errors import RuleError, SettingsError
from tcrdata.plan import first_round_presets, speaks_anew
from tcrdata.resources import resource_files
from tcrdata.rules import load_follower, load_preset, load_rules, preset_names
from tcrdata.rules.preset_files import check_presets

HEAD = "-- Mine.\n-- rules: source, range\n-- required: source\n-- cues: tracks\n"
SELECT = "select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p\n"
Write = Callable[[str, str], Path]


def test_shipped_presets_load_together() -> None:
    assert preset_names() == [
        "detector", "detector_faint", "paper", "paper_ensemble", "release", "release_ensemble",
        "tabletop", "tabletop_learned", "tabletop_learned_tracked", "tabletop_moving",
        "tabletop_moving_learned", "tabletop_tracked", "tcrdata", "tcrdata_learned",
        "tcrdata_learned_tracked", "tcrdata_static", "tcrdata_tracked",
    ]  # fmt: skip
    presets = {preset.name: preset for preset in check_presets(preset_names())}
    assert presets["paper"].fill().parameters["max_cycle_error_m"] == "0.25"
    assert presets["release"].fill().parameters["max_cycle_error_m"] == "0.1"
    used = {rule.name for preset in presets.values() for rule in preset.rules}
    assert used == set(load_rules())


def test_first_rounds_name_who_selects_after_them() -> None:
    after = {name: load_preset(name).successor for name in first_round_presets()}
    assert after == {
        "paper": "paper_ensemble",
        "release": "release_ensemble",
        "tabletop": "tabletop_learned",
        "tabletop_moving": "tabletop_moving_learned",
        "tabletop_tracked": "tabletop_learned",
        "tcrdata": "tcrdata_learned",
        "tcrdata_static": "tcrdata_learned",
        "tcrdata_tracked": "tcrdata_learned",
    }
    learnt = [load_preset(name) for name in after.values()]
    assert all(any(map(speaks_anew, preset.cues)) for preset in learnt)
    assert all(preset.successor == preset.name for preset in learnt)


def test_who_takes_the_tracked_boxes_of_whose_labels(write_sql: Write) -> None:
    follows = {name: load_preset(name).follows for name in preset_names()}
    assert {name: whom for name, whom in follows.items() if whom} == {
        "tabletop_tracked": "tabletop",
        "tabletop_learned_tracked": "tabletop_learned",
        "tcrdata_tracked": "tcrdata",
        "tcrdata_learned_tracked": "tcrdata_learned",
    }
    assert load_follower("tcrdata").name == "tcrdata_tracked"
    own = write_sql("my.sql", HEAD + SELECT)
    with pytest.raises(SettingsError, match="-- follows: my"):
        load_follower(str(own))
    write_sql("mine_tracked.sql", HEAD + "-- follows: my\n" + SELECT)
    assert load_follower(str(own)).name == "mine_tracked"


def test_a_preset_and_rules_of_ones_own(write_sql: Write) -> None:
    write_sql(
        "rules/long.sql",
        "-- It is long.\n-- source: me\n-- needs: value > mine_m\n-- cues:\n"
        "set variable mine_m = 1;  -- m: length\n"
        "select p.proposal_id, p.length_m as value, getvariable('mine_m')::double as bound,\n"
        "       p.length_m > getvariable('mine_m') as passed from proposals p\n",
    )
    path = write_sql(
        "my.sql", HEAD.replace("range", "long") + "set variable mine_m = 2;\n" + SELECT
    )
    preset = load_preset(str(path))
    assert [rule.name for rule in preset.rules] == ["source", "long"]
    assert preset.fill().parameters["mine_m"] == "2"
    assert preset.cues == ("tracks",)


def test_overrides_are_filled_in_one_spelling() -> None:
    preset = load_preset("paper")
    text, number = (
        preset.fill({"max_cycle_error_m": "0.10"}),
        preset.fill({"max_cycle_error_m": 0.1}),
    )
    assert text == number != preset.fill()
    assert "(0.1)" in next(rule.select for rule in text.rules if rule.name == "cycle_error")
    assert preset.fill({"egomotion_method": "odometry"}).parameters["egomotion_method"] == (
        "'odometry'"
    )


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"max_cycle_eror_m": 1}, "has no parameter 'max_cycle_eror_m'; near: max_cycle_error_m"),
        ({"max_cycle_error_m": "far"}, "max_cycle_error_m must be a number, not 'far'"),
        ({"max_cycle_error_m": "nan"}, "must be a finite number"),
        ({"max_cycle_error_m": True}, "must be a"),
        ({"egomotion_method": 3}, "egomotion_method must be text"),
        ({"min_voxels": 1}, "has no parameter 'min_voxels'"),
    ],
)
def test_wrong_overrides_are_refused(overrides: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match="parameter") as caught:
        load_preset("paper").fill(overrides)
    assert message in str(caught.value)


def test_unknown_preset_lists_those_there_are() -> None:
    with pytest.raises(SettingsError, match=r"no preset 'papr'; there are detector, .*, tcrdata"):
        load_preset("papr")
    with pytest.raises(SettingsError, match=r"no preset '/nowhere/my\.sql'"):
        load_preset("/nowhere/my.sql")


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (HEAD.replace("range", "rnge") + SELECT, SettingsError, "no rule 'rnge'; there are"),
        (HEAD.replace("source, range", "") + SELECT, RuleError, "lists no rule"),
        (HEAD.replace("range", "source") + SELECT, RuleError, "listed twice"),
        (HEAD.replace("d: source", "d: height") + SELECT, RuleError, "required names height"),
        (HEAD.replace("range", "voxels") + SELECT, RuleError, "name one in `-- cues:`"),
        (HEAD.replace("-- cues: tracks\n", "") + SELECT, RuleError, "lacks a line '-- cues: ...'"),
        (HEAD + "set variable min_voxels = 1;\n" + SELECT, RuleError, "does not list"),
        (HEAD + "set variable min_range_m = 'far';\n" + SELECT, RuleError, "must be a number"),
        (HEAD + "set variable lost = 1;\n" + SELECT, RuleError, "neither its select nor a rule"),
        (HEAD + SELECT.replace("1.0::double", "1"), RuleError, "column score is INTEGER"),
        (HEAD + SELECT.replace("from prop", "from labels, prop"), RuleError, "my.sql:5: "),
        (HEAD + "drop table proposals", RuleError, "only reads"),
        (HEAD + "-- ignore: my\n" + SELECT, RuleError, "names the preset itself"),
        (HEAD + "-- ignore: papr\n" + SELECT, RuleError, "names papr, which is no preset"),
        (HEAD + "-- loosened: min_range_m\n" + SELECT, RuleError, "needs name = value"),
        (HEAD + "-- loosened: min_rnge_m = 3\n" + SELECT, RuleError, "near: min_range_m"),
        (HEAD + "-- loosened: min_range_m = x\n" + SELECT, RuleError, "must be a number"),
    ],
)
def test_a_wrong_preset_is_refused(
    write_sql: Write, text: str, error: type[Exception], message: str
) -> None:
    path = write_sql("my.sql", text)
    with pytest.raises(error) as caught:
        load_preset(str(path))
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_rules_and_settings_share_no_name() -> None:
    """A bound that decides a label lives in SQL alone."""
    parameters = {p.name for rule in load_rules().values() for p in rule.parameters}
    evidence = Path(resource_files("queries/rules/*.sql")[0]).parents[2] / "tcrdata" / "evidence"
    for path in evidence.glob("*.py"):
        words = set(path.read_text(encoding="utf-8").replace(":", " ").replace("(", " ").split())
        assert not words & parameters, f"{path.name} has a rule's parameter"
