"""A wrong rule fails when it loads, with its file, its line and what to do."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import duckdb
import pytest

from tcrdata.errors import RuleError
from tcrdata.rules.binding import STEADY, Binder, unsteady
from tcrdata.rules.parameters import to_literal
from tcrdata.rules.rule_files import load_rules
from tcrdata.rules.scopes import handing_on
from tcrdata.rules.sql_files import fill_in, uses
from tcrdata.rules.syntax_trees import SyntaxTree

HEAD = "-- It is near.\n-- source: none\n-- needs: value <= most_m\n-- cues:\n"
SET = "set variable most_m = 5.5;  -- m: distance\n"
SELECT = (
    "select p.proposal_id, p.range_m as value, getvariable('most_m')::double as bound,\n"
    "       p.range_m <= getvariable('most_m') as passed\n"
    "from proposals p\n"
)
Write = Callable[[str, str], Path]


def test_a_rule_of_ones_own_loads(write_sql: Write) -> None:
    with Binder() as binder:
        path = write_sql("near.sql", HEAD + SET + "\n" + SELECT)
        rule = load_rules(path.parent, binder, ["near"])["near"]
    assert (rule.name, rule.decides, rule.needs) == ("near", "It is near.", "value <= most_m")
    (parameter,) = rule.parameters
    assert (parameter.literal, parameter.kind) == ("5.5", "number")
    assert (parameter.unit, parameter.meaning, parameter.line) == ("m", "distance", 5)
    assert rule.reads.tables == ("proposals",)
    assert {"range_m", "proposal_id"} <= set(rule.reads.columns)
    assert "p.range_m <= (7)" in rule.select({"most_m": "7"})


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (HEAD + SELECT, 5, "most_m is used but not set"),
        (HEAD + SET + SELECT.replace("most_m')", "other')"), 6, "other is used but not set"),
        (HEAD + SET + SELECT.replace("getvariable('most_m')", "1"), 5, "set but not used"),
        (HEAD + SET + SELECT.replace("p.range_m <=", "p.rnge_m <="), 7, "rnge_m"),
        (HEAD + SET + SELECT.replace("from proposals", "from propsals"), 8, "propsals"),
        (HEAD + SET + SELECT.replace("from proposals", "fom proposals"), 8, "syntax error"),
        (HEAD + SET + SELECT.replace("::double", ""), 6, "column bound is DECIMAL(2,1), it must"),
        (HEAD + SET + SELECT.replace("as value", "as val"), 6, "the select gives columns"),
        (HEAD + SET + SELECT.replace("p.proposal_id, ", ""), 6, "the select gives columns"),
        (HEAD + SET + "create table t as\n" + SELECT, 6, "only reads"),
        (HEAD + SET + "delete from proposals;\n" + SELECT, 6, "only `set variable` lines"),
        (HEAD + SET + SELECT + ";\n" + SELECT, 6, "only `set variable` lines"),
        (HEAD + SET, 5, "must end with one select"),
        (HEAD, 1, "no statement"),
        (HEAD.replace("-- source: none\n", "") + SET + SELECT, 1, "lacks a line '-- source: ...'"),
        (HEAD.replace("-- It is near.\n", "") + SET + SELECT, 1, "a sentence on what it decides"),
        (HEAD + SET.replace("  -- m: distance", "") + SELECT, 5, "say what most_m means"),
        (HEAD + SET + SET + SELECT, 6, "set twice"),
        (HEAD + SET.replace("5.5", "[1, 2]") + SELECT, 5, "a parameter is a number, text"),
        (HEAD + SET.replace("5.5", "nothing(1)") + SELECT, 5, "nothing"),
        (HEAD + SET + SELECT.replace("p.range_m as", "random() as"), 6, "random() may differ"),
        (HEAD + SET + SELECT.replace("from prop", "from ground_truth g, prop"), 8, "ground_truth"),
        (HEAD + SET + SELECT.replace("from prop", "from labels g, prop"), 8, "evidence tables are"),
        (HEAD + SET + SELECT.replace("from prop", "from 'truth.parquet' g, prop"), 6, "disabled"),
        (HEAD + SET + SELECT.replace("from prop", "from proposals q, prop"), 6, "by itself"),
        (
            HEAD + SET + SELECT.replace("p.range_m as", "avg(p.range_m) over () as"),
            6,
            "by itself",
        ),
    ],
)
def test_a_wrong_rule_names_file_line_and_reason(
    write_sql: Write, text: str, line: int, message: str
) -> None:
    path = write_sql("near.sql", text)
    with Binder() as binder, pytest.raises(RuleError) as caught:
        load_rules(path.parent, binder, ["near"])
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "near.sql").write_bytes(b"\xff\xfe")
    with pytest.raises(RuleError, match=r"near\.sql: cannot be read"):
        load_rules(tmp_path)


def test_names_of_rules_and_parameters_are_taken_once(write_sql: Write) -> None:
    folder = write_sql("own/near.sql", HEAD + SET + SELECT).parent
    assert "near" in load_rules(folder)
    twice = write_sql("own/nearer.sql", HEAD + SET + SELECT)
    with pytest.raises(RuleError, match=r"parameter most_m is set in near\.sql too"):
        load_rules(folder)
    twice.unlink()
    write_sql("own/travels.sql", (HEAD + SET + SELECT).replace("most_m", "mine_m"))
    with pytest.raises(RuleError, match="a rule travels is in"):
        load_rules(folder)


def test_filling_in_leaves_strings_and_comments_alone() -> None:
    select = "select 'getvariable(''a'')', /* getvariable('a') */ GetVariable ( 'a' ), 'é' -- \n+ getvariable('b')"  # noqa: E501
    assert uses(select) == [("a", 0), ("b", 1)]
    assert fill_in(select, {"a": "1", "b": "'x'"}) == (
        "select 'getvariable(''a'')', /* getvariable('a') */ (1), 'é' -- \n+ ('x')"
    )


@pytest.mark.parametrize(
    ("value", "kind", "literal"),
    [
        ("0.10", "number", "0.1"),
        (100, "number", "100"),
        ("1e-3", "number", "0.001"),
        (-2.5, "number", "-2.5"),
        ("-0", "number", "0"),
        ("it's", "text", "'it''s'"),
        ("TRUE", "true or false", "true"),
        (False, "true or false", "false"),
    ],
)
def test_equal_values_have_one_spelling(value: object, kind: str, literal: str) -> None:
    assert to_literal(value, kind) == literal  # type: ignore[arg-type]


def test_what_is_taken_for_steady_is() -> None:
    assert not STEADY & unsteady()


SAID = "with said as (select {key}, max(confidence) as most from confidences group by {group})\n"
OWN = "p.proposal_id = s.proposal_id"
JOINED = "select p.proposal_id, s.most as value from proposals p left join {said} s on {on}"


@pytest.mark.parametrize(
    ("key", "group", "said", "on", "once"),
    [
        ("proposal_id", "proposal_id", "said", OWN, True),
        ("proposal_id", "proposal_id", "said", f"{OWN} and s.most > 1", True),
        ("proposal_id, frame", "proposal_id, frame", "said", OWN, False),
        ("proposal_id", "proposal_id, frame", "said", OWN, False),
        ("proposal_id", "proposal_id", "said", "s.proposal_id >= p.proposal_id", False),
        ("proposal_id", "proposal_id", "said", "s.proposal_id = s.proposal_id", False),
        ("lower(proposal_id) as proposal_id", "all", "said", OWN, False),
        ("proposal_id", "proposal_id", "confidences", OWN, False),
    ],
)
def test_only_what_is_joined_by_all_that_it_is_grouped_by_matches_once(
    key: str, group: str, said: str, on: str, once: bool
) -> None:
    text = SAID.format(key=key, group=group) + JOINED.format(said=said, on=on)
    text = text.replace("s.most", "s.confidence") if said == "confidences" else text
    (serialized,) = duckdb.execute("select json_serialize_sql($1)", [text]).fetchall()
    tree = SyntaxTree(json.loads(serialized[0]))
    assert tree.row_by_row is once
    assert tree.starts_with_id
    whole = handing_on(text, "{p}.*")
    assert whole is not None
    assert whole.startswith(text.partition("select p.")[0] + "select p.*, s.")
