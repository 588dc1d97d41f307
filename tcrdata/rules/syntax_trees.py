"""What DuckDB's syntax tree of a select says of its form."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

_MULTIPLY = {"unnest", "unlist", "generate_subscripts"}
"""Functions that make several rows of one."""

_CLAUSES = ("group_expressions", "having", "qualify", "sample", "modifiers")
"""Parts of a select, but `where`, after which rows are not those that it joined."""


_KEEPING_LEFT = ("LEFT", "INNER", "ANTI", "SEMI")
"""Kinds of joins that make no row which has nothing of the left side."""


class SyntaxTree:
    """What occurs in the syntax tree of one select."""

    def __init__(self, tree: Any) -> None:
        self._nodes = list(_dictionaries(tree))
        self._node = tree["statements"][0]["node"]

    @cached_property
    def tables(self) -> list[str]:
        """Names of tables read, common table expressions included."""
        return [n["table_name"] for n in self._nodes if n.get("type") == "BASE_TABLE"]

    @cached_property
    def functions(self) -> list[str]:
        """Names of functions called."""
        return [n["function_name"] for n in self._nodes if "function_name" in n]

    @cached_property
    def classes(self) -> set[str]:
        """Kinds of expressions."""
        return {str(n["class"]) for n in self._nodes if "class" in n}

    @property
    def star(self) -> bool:
        """Whether `*`, a whole row or a natural join makes every column count as read."""
        natural = any(n.get("ref_type") == "NATURAL" for n in self._nodes)
        return natural or "STAR" in self.classes or "proposals" in self.words

    @property
    def passes_id(self) -> bool:
        """Whether `proposal_id` occurs as the first column of the result and nowhere else."""
        names = [w for n in self._nodes for w in n.get("column_names", [])]
        names += [w for n in self._nodes for w in n.get("using_columns", [])]
        once = names.count("proposal_id") == 1 and not self.star
        return once and self._first[-1:] == ["proposal_id"]

    @property
    def row_by_row(self) -> bool:
        """Whether it drops and adds no row of `proposals`.

        It plainly selects from them, or left joins what has at most one row for each.
        """
        if _MULTIPLY & set(self.functions) or self._node.get("where_clause"):
            return False
        joined = self._left_joined
        return joined is not None and all(self._matches_once(join) for join in joined)

    @property
    def starts_with_id(self) -> bool:
        """Whether it plainly selects `p.proposal_id, ...` from `proposals p` and left joins."""
        leaf = self._leaf
        if self._left_joined is None or leaf.get("table_name") != "proposals":
            return False
        once = self.tables.count("proposals") == 1 and "proposals" not in self._expressions
        return once and self._first == [leaf.get("alias") or "proposals", "proposal_id"]

    @property
    def hands_on_rows(self) -> bool:
        """Whether it plainly selects `p.proposal_id, ...` from `proposals p` and any such joins.

        As `starts_with_id`, but joins may drop rows, and `proposals` may be read again.
        """
        leaf = self._leaf
        joined = self._joined
        if joined is None or any(join["join_type"] not in _KEEPING_LEFT for join in joined):
            return False
        own = leaf.get("table_name") == "proposals" and "proposals" not in self._expressions
        return own and self._first == [leaf.get("alias") or "proposals", "proposal_id"]

    @property
    def each_alone(self) -> bool:
        """Whether it starts with the id, and no row that it gives depends on two of `proposals`."""
        if self.functions or self.classes & {"SUBQUERY", "WINDOW", "STAR"}:
            return False
        joined = self._left_joined or []
        return self.starts_with_id and all(j["right"].get("type") == "BASE_TABLE" for j in joined)

    @cached_property
    def words(self) -> set[str]:
        """Every part of every column reference."""
        words = {w for n in self._nodes for w in n.get("column_names", [])}
        return words | {w for n in self._nodes for w in n.get("using_columns", [])}

    @property
    def _first(self) -> list[str]:
        """The parts of the name in the first column of the result; none where it is no name."""
        columns = self._node.get("select_list") or [{}]
        return list(columns[0].get("column_names", []))

    @cached_property
    def _expressions(self) -> dict[str, Any]:
        """Name of a common table expression to its select."""
        return {
            found["key"]: found["value"].get("query_node", {})
            for found in self._node.get("cte_map", {}).get("map", [])
        }

    @cached_property
    def _leaf(self) -> dict[str, Any]:
        """What the select reads from, of joins the leftmost."""
        leaf: dict[str, Any] = self._node.get("from_table") or {}
        while leaf.get("type") == "JOIN":
            leaf = leaf["left"]
        return leaf

    @property
    def _left_joined(self) -> list[dict[str, Any]] | None:
        """The joins of a plain select from a table, all of them left; None for any other."""
        joins = self._joined
        left = joins is not None and all(join["join_type"] == "LEFT" for join in joins)
        return joins if left else None

    @cached_property
    def _joined(self) -> list[dict[str, Any]] | None:
        """The joins of a plain select from a table; None for any other."""
        grouped = self._node.get("aggregate_handling", "STANDARD_HANDLING") != "STANDARD_HANDLING"
        leaf = self._leaf
        if grouped or any(self._node.get(clause) for clause in _CLAUSES):
            return None
        if leaf.get("type") != "BASE_TABLE" or leaf.get("sample"):
            return None
        joins = []
        join = self._node["from_table"]
        while join is not leaf:
            joins.append(join)
            join = join["left"]
        return joins

    def _matches_once(self, join: dict[str, Any]) -> bool:
        """Whether it joins a grouped common table expression by all that it is grouped by."""
        right, condition = join["right"], join.get("condition") or {}
        if right.get("type") != "BASE_TABLE" or right.get("column_name_alias"):
            return False
        keys = _group_keys(self._expressions.get(right["table_name"], {}))
        name = right.get("alias") or right["table_name"]
        both = condition.get("type") == "CONJUNCTION_AND"
        parts = condition["children"] if both else [condition]
        return bool(keys) and keys <= {key for part in parts for key in _equalled(part, name)}


def _group_keys(select: dict[str, Any]) -> set[str]:
    """The columns by which a select is grouped and whose values together it gives once.

    Empty where that does not show in its form.
    """
    groups = select.get("group_expressions") or []
    names = [group.get("column_names", [""])[-1] for group in groups]
    given = {
        name: [
            column.get("class") == "COLUMN_REF" and column["column_names"][-1] == name
            for column in select["select_list"]
            if name in (column.get("alias"), column.get("column_names", [""])[-1])
        ]
        for name in names
    }
    plain = len(select.get("group_sets") or []) == 1 and "" not in names
    return set(names) if plain and all(its == [True] for its in given.values()) else set()


def _equalled(condition: dict[str, Any], table: str) -> set[str]:
    """The columns of a table that a condition demands to equal something of another."""
    if condition.get("type") != "COMPARE_EQUAL":
        return set()
    left, right = (condition[side].get("column_names", []) for side in ("left", "right"))
    own = [names[-1] for names in (left, right) if names[:-1] == [table]]
    return set(own) if len(own) == 1 and len(left) == len(right) == 2 else set()


def _dictionaries(tree: Any) -> Iterator[dict[str, Any]]:
    """Every dictionary in nested lists and dictionaries, in the order of the text."""
    waiting = [tree]
    while waiting:
        found = waiting.pop()
        if isinstance(found, dict):
            yield found
            found = list(found.values())
        if isinstance(found, list):
            waiting += [child for child in reversed(found) if isinstance(child, (dict, list))]
