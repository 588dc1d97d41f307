"""Cases of rules of one's own: where they differ, and what is wrong with a folder or a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tcrdata.errors import RuleError, SettingsError
from tcrdata.inspection.rule_cases import Difference, run_cases
from tcrdata.rules import load_rules

RULE = """-- Near enough to be seen well.
-- source: none
-- needs: value <= most_m
-- cues:
set variable most_m = 5.5;  -- m: distance
select p.proposal_id, p.range_m as value, getvariable('most_m')::double as bound,
       value <= bound as passed
from proposals p
"""
HOLDS = """
[[case]]
name = "near and far"
given.proposals = [{ range_m = 5.5 }, { range_m = 5.6 }]
expected = [
  { value = 5.5, bound = 5.5, passed = true },
  { value = 5.6, bound = 5.5, passed = false },
]
"""


def folder_of(folder: Path, cases: str | None = HOLDS, name: str = "near") -> str:
    (folder / "rules").mkdir(parents=True, exist_ok=True)
    (folder / "cases").mkdir(exist_ok=True)
    (folder / "rules" / "near.sql").write_text(RULE)
    if cases is not None:
        (folder / "cases" / f"{name}.toml").write_text(cases)
    return str(folder)


def test_the_rules_that_ship_hold_all_their_cases() -> None:
    results = run_cases()
    assert results.differences == ()
    assert results.untested == ()
    assert set(results.cases) == set(load_rules())
    assert sum(results.cases.values()) > 60


def test_a_folder_of_ones_own_is_run_alone(tmp_path: Path) -> None:
    results = run_cases(folder_of(tmp_path))
    assert results.cases == {"near": 1}
    assert results.differences == ()


def test_rules_and_cases_may_lie_side_by_side(tmp_path: Path) -> None:
    (tmp_path / "near.sql").write_text(RULE)
    (tmp_path / "near.toml").write_text(HOLDS)
    assert run_cases(str(tmp_path)).cases == {"near": 1}


def test_a_rule_that_ships_may_get_cases_of_ones_own(tmp_path: Path) -> None:
    folder_of(tmp_path)
    (tmp_path / "cases" / "range.toml").write_text(
        '[[case]]\nname = "six metres"\ngiven.proposals = [{ range_m = 6.0 }]\n'
        "expected = [{ value = 6.0, bound = 4.0, passed = true }]\n"
    )
    assert run_cases(str(tmp_path)).cases == {"near": 1, "range": 1}


def test_each_difference_is_found(tmp_path: Path) -> None:
    wrong = HOLDS.replace("value = 5.6, bound = 5.5, passed = false", "value = 5.0, bound = 5.5")
    assert run_cases(folder_of(tmp_path, wrong)).differences == (
        Difference("near", "near and far", 2, "value", 5.0, 5.6),
        Difference("near", "near and far", 2, "passed", None, False),
    )


@pytest.mark.parametrize(("tolerance", "differs"), [("0.2", False), ("0.01", True), ("0", True)])
def test_a_tolerance_is_in_the_unit_of_the_number(
    tmp_path: Path, tolerance: str, differs: bool
) -> None:
    near = HOLDS.replace("value = 5.6,", "value = 5.7,")
    near = near.replace('far"\n', f'far"\ntolerance = {tolerance}\n')
    assert bool(run_cases(folder_of(tmp_path, near)).differences) is differs


def test_a_case_sets_parameters(tmp_path: Path) -> None:
    far = HOLDS.replace('far"\n', 'far"\nset = { most_m = 7 }\n')
    found = run_cases(folder_of(tmp_path, far)).differences
    assert [(d.proposal, d.what, d.expected, d.found) for d in found] == [
        (1, "bound", 5.5, 7.0),
        (2, "bound", 5.5, 7.0),
        (2, "passed", False, True),
    ]


def test_a_rule_that_drops_a_proposal_differs(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    (tmp_path / "rules" / "near.sql").write_text(RULE + "where p.range_m < 5.55\n")
    assert run_cases(folder).differences == (Difference("near", "near and far", 2, "rows", 2, 1),)


def test_a_rule_without_cases_is_named(tmp_path: Path) -> None:
    results = run_cases(folder_of(tmp_path, cases=None))
    assert results.cases == {"near": 0}
    assert results.untested == ("near",)


@pytest.mark.parametrize(
    ("cases", "message"),
    [
        ("[[case]\n", "cannot be read as TOML .*line 1"),
        ("", "holds no list of cases"),
        ("case = 3\n", "holds no list of cases"),
        ('[[case]]\nname = "a"\n', "case 'a': has 0 given.proposals and 0 expected"),
        (HOLDS.replace("{ value = 5.6, bound = 5.5, passed = false },", ""), "2 given.* 1 expect"),
        (HOLDS.replace('far"\n', 'far"\ntolerence = 1\n'), "'tolerence' is none of name, set"),
        (HOLDS.replace('far"\n', 'far"\ntolerance = -1\n'), "tolerance -1: give a number"),
        (HOLDS.replace('far"\n', 'far"\nset = { most = 7 }\n'), "set.most is no parameter of rule"),
        (HOLDS.replace('far"\n', 'far"\nset = { most_m = "x" }\n'), "set.most_m must be a number"),
        (HOLDS.replace("range_m = 5.6", "rnge_m = 5.6"), "given.proposals, row 2: .*rnge_m"),
        (HOLDS.replace("range_m = 5.6", 'range_m = "far"'), "given.proposals, row 2: .*far"),
        (HOLDS.replace("passed = true", "pased = true"), "pased.*: a verdict has value, bound"),
        (HOLDS + "given.ground_truth = [{}]\n", "given.ground_truth is no table that rules may"),
        (HOLDS + "given.egomotions = [3]\n", "is a list of rows"),
        (HOLDS + "set = 3\n", "set is a table of parameters"),
        (HOLDS + "given.frames = 3\n", "given.<table> is a list of rows"),
    ],
)
def test_a_wrong_case_file_is_named(tmp_path: Path, cases: str, message: str) -> None:
    with pytest.raises(RuleError, match=message) as error:
        run_cases(folder_of(tmp_path, cases))
    assert "near.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_cases_without_their_rule_are_named(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="there is no rule 'nare'"):
        run_cases(folder_of(tmp_path, name="nare"))


def test_a_folder_without_rules_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="holds no rule: put them into"):
        run_cases(str(tmp_path))
    with pytest.raises(SettingsError, match="is no folder"):
        run_cases(str(tmp_path / "none"))
