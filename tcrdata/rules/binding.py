"""Binds selects on empty typed tables, so that a wrong rule fails when it loads.

The tables that a rule may read are made here and no others: what is true, what was decided and how
it scored are out of reach, and so are files.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import duckdb

from tcrdata.errors import RuleError
from tcrdata.rules.scopes import located
from tcrdata.rules.sql_files import SqlFile, fill_in, uses
from tcrdata.rules.syntax_trees import SyntaxTree
from tcrdata.store import schemas

EVIDENCE_TABLES = ("proposals", "confidences", "egomotions", "frames", "sequences")
"""What rules and presets may read: measured, light, and never the truth."""

RULE_COLUMNS = {
    "proposal_id": "VARCHAR",
    "value": "DOUBLE",
    "bound": "DOUBLE",
    "passed": "BOOLEAN",
}
PRESET_COLUMNS = {"proposal_id": "VARCHAR", "state": "VARCHAR", "score": "DOUBLE"}
KEY_COLUMNS = ("proposal_id", "dataset", "sequence", "frame", "round")

STEADY = frozenset(
    ("*", "+", "-", "/", "abs", "coalesce", "cos", "count", "greatest", "if", "least", "list",
     "list_avg", "list_contains", "list_count", "list_position", "list_sum", "list_value",
     "list_zip", "max", "min", "row", "sin", "sqrt", "string_split", "sum", "||")
)  # fmt: skip
"""Functions known to say the same every time; DuckDB is asked, which takes a while, of others."""


@dataclass(frozen=True)
class Reads:
    """What a select reads.

    Attributes:
        tables: evidence tables, sorted.
        columns: columns of `proposals`, in the order of the schema.
        named: those of them that occur in the text, keys or not.
        passes_id: `proposal_id` is handed on as the first column and not used otherwise.
        row_by_row: by its form the select gives one row for each row of `proposals`.
        starts_with_id: by its form each row starts with the id of the row of `proposals` that it is
            of, whose other columns it could have in the id's place.
        hands_on_rows: the same of the rows that it gives, though not all may have one.
        each_alone: besides, no row that the select gives depends on two rows of `proposals`.
    """

    tables: tuple[str, ...]
    columns: tuple[str, ...]
    named: tuple[str, ...]
    passes_id: bool
    row_by_row: bool
    starts_with_id: bool
    hands_on_rows: bool
    each_alone: bool


class Binder:
    """An empty store in memory; one serves many files.

    Attributes:
        connection: to its empty tables.
    """

    def __init__(self) -> None:
        self.connection = duckdb.connect()
        for table in EVIDENCE_TABLES:
            self.connection.execute(schemas.ddl(table))
        self.connection.execute("set enable_external_access = false")

    def close(self) -> None:
        """Free the connection."""
        self.connection.close()

    def __enter__(self) -> Binder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def bind(
        self,
        files: Sequence[tuple[SqlFile, Mapping[str, str]]],
        result: Mapping[str, str],
        *,
        alone: bool,
    ) -> list[Reads]:
        """Bind the selects of some files with their parameters filled in.

        Args:
            files: rules or presets, each with a literal for each parameter that it may read; all
                together take a third of the time of one by one.
            result: column name to DuckDB type, in order.
            alone: a rule judges a proposal by itself: `proposals` once and no window, so that it
                says the same of a proposal whichever others it sees.

        Raises:
            RuleError: with file and line.
        """
        selects = [_filled(file, literals) for file, literals in files]
        if not self._all_give(selects, result):
            for (file, _), select in zip(files, selects, strict=True):
                _check_result(file, self._describe(file, select), result)
        trees = self._parse(selects)
        for (file, _), tree in zip(files, trees, strict=True):
            _check_functions(file, tree)
            if alone:
                _check_alone(file, tree)
        return [_reads(tree) for tree in trees]

    def _all_give(self, selects: Sequence[str], result: Mapping[str, str]) -> bool:
        """Whether DuckDB binds all selects, and each gives these columns."""
        together = ", ".join(f"({select}\n) s{place}" for place, select in enumerate(selects))
        try:
            rows = self.connection.execute(f"describe select * from {together}").fetchall()
        except duckdb.Error:
            return False
        return [(row[0], row[1]) for row in rows] == list(result.items()) * len(selects)

    def _describe(self, file: SqlFile, select: str) -> list[tuple[str, str]]:
        """Names and types of the columns the select gives."""
        try:
            rows = self.connection.execute("describe " + select).fetchall()
        except duckdb.Error as error:
            hint = f" (evidence tables are {', '.join(EVIDENCE_TABLES)})"
            known = isinstance(error, duckdb.CatalogException) and "Table with name" in str(error)
            message = located(file.path, file.select_line, error)
            raise RuleError(message + hint * known) from error
        return [(row[0], row[1]) for row in rows]

    def _parse(self, selects: Sequence[str]) -> list[SyntaxTree]:
        """DuckDB's syntax trees."""
        sql = "select json_serialize_sql(unnest($1::varchar[]))"
        rows = self.connection.execute(sql, [selects]).fetchall()
        return [SyntaxTree(json.loads(text)) for (text,) in rows]


def _filled(file: SqlFile, literals: Mapping[str, str]) -> str:
    """The select of a file, of whose parameters none is left open."""
    for name, line in uses(file.select):
        if name not in literals:
            raise RuleError(
                f"{file.path}:{file.select_line + line}: parameter {name} is used but not set; "
                f"add `set variable {name} = ...;  -- unit: meaning`"
            )
    return fill_in(file.select, literals)


def _check_result(file: SqlFile, found: list[tuple[str, str]], wanted: Mapping[str, str]) -> None:
    """The result has these columns, in this order, of these types."""
    where = f"{file.path}:{file.select_line}"
    names = [name for name, _ in found]
    if names != list(wanted):
        raise RuleError(
            f"{where}: the select gives columns ({', '.join(names)}), "
            f"it must give ({', '.join(wanted)})"
        )
    for name, kind in found:
        if kind != wanted[name]:
            raise RuleError(
                f"{where}: column {name} is {kind}, it must be {wanted[name]}; "
                f"cast it with ::{wanted[name].lower()}"
            )


def _reads(tree: SyntaxTree) -> Reads:
    """What the select of a tree reads."""
    tables = tuple(sorted(t for t in set(tree.tables) if t in EVIDENCE_TABLES))
    known = [name for name, _, _ in schemas.columns("proposals")]
    read = {*(known if tree.star else tree.words)}
    columns = tuple(name for name in known if name in {*KEY_COLUMNS, *read})
    named = tuple(name for name in known if name in read)
    return Reads(
        tables, columns, named, tree.passes_id, tree.row_by_row, tree.starts_with_id,
        tree.hands_on_rows, tree.each_alone and set(tree.tables) <= set(EVIDENCE_TABLES),
    )  # fmt: skip


@cache
def unsteady() -> frozenset[str]:
    """Functions of time, chance, session or state: the same in every connection."""
    with duckdb.connect() as connection:
        rows = connection.execute(
            "select distinct function_name from duckdb_functions() "
            "where stability in ('VOLATILE', 'CONSISTENT_WITHIN_QUERY')"
        ).fetchall()
    return frozenset(str(name) for (name,) in rows) - {"error"}


def _check_functions(file: SqlFile, tree: SyntaxTree) -> None:
    """Refuse what may say something else tomorrow."""
    others = set(tree.functions) - STEADY
    unstable = sorted(others and others & unsteady())
    if unstable:
        raise RuleError(
            f"{file.path}:{file.select_line}: {unstable[0]}() may differ from run to run; "
            "a verdict depends on evidence and parameters alone"
        )


def _check_alone(file: SqlFile, tree: SyntaxTree) -> None:
    """A rule looks at one proposal at a time."""
    if tree.tables.count("proposals") != 1 or "WINDOW" in tree.classes:
        raise RuleError(
            f"{file.path}:{file.select_line}: a rule judges each proposal by itself: name "
            "`proposals` once and use no window; compare proposals in the preset's select"
        )
