"""Parameters of rules and presets: their `set variable` lines, and values as literals."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, Literal

import duckdb

from tcrdata.errors import RuleError
from tcrdata.rules.scopes import located, quoted
from tcrdata.rules.tokens import Token, line_of, tokens

Kind = Literal["number", "text", "true or false"]

_NUMBER = re.compile(r"-?\d{1,9}(\.\d{1,9})?")
_TEXT = re.compile("'[^']*'")


@dataclass(frozen=True)
class Parameter:
    """A `set variable` line.

    Attributes:
        name: unique over all rules and presets.
        literal: its value as a DuckDB literal in one canonical spelling.
        kind: what an override must be.
        unit: before the colon of the line's comment; empty without one.
        meaning: after it.
        path: file.
        line: 1-based.
    """

    name: str
    literal: str
    kind: Kind
    unit: str
    meaning: str
    path: Path
    line: int


def to_literal(value: object, kind: Kind) -> str:
    """Spell a value as a literal, the same for equal values.

    Raises:
        ValueError: the value is not of that kind; the message says what it must be.
    """
    if kind == "text":
        if isinstance(value, str):
            return "'" + value.replace("'", "''") + "'"
        raise ValueError("must be text")
    if kind == "true or false":
        if str(value).lower() in ("true", "false"):
            return str(value).lower()
        raise ValueError("must be true or false")
    try:
        number = Decimal(str(value))
    except InvalidOperation:
        raise ValueError("must be a number") from None
    if isinstance(value, bool) or not number.is_finite():
        raise ValueError("must be a finite number")
    return format(number.normalize() + 0, "f")


def read_parameters(
    path: Path, text: str, settings: list[Token], connection: duckdb.DuckDBPyConnection
) -> tuple[Parameter, ...]:
    """Read the `set variable` lines of a file.

    Args:
        path: file.
        text: its content.
        settings: byte offset and text of each line.
        connection: evaluates what is no plain literal.

    Raises:
        RuleError: with file and line.
    """
    words = [_words(path, text, *setting) for setting in settings]
    plain = [_plain("".join(value)) for _, _, _, _, *value in words]
    values = [value for value in plain if value is not None]
    if len(values) < len(settings):
        values = _evaluated(path, text, settings, [name for _, _, name, *_ in words], connection)
    found = []
    for (at, statement), (_, _, name, *_), (value, type_name) in zip(
        settings, words, values, strict=True
    ):
        line, kind = line_of(text, at), _kind(value, type_name)
        if kind is None:
            reason = f"{name} is {type_name}; a parameter is a number, text or boolean"
            raise RuleError(f"{path}:{line}: {reason}")
        unit, meaning = _comment(text, at + len(statement.encode()))
        found.append(Parameter(name, to_literal(value, kind), kind, unit, meaning, path, line))
    return tuple(found)


def _words(path: Path, text: str, start: int, statement: str) -> list[str]:
    """`set`, `variable`, its name, `=`, and its value in one or more words."""
    words = [token.strip() for _, token in tokens(statement)]
    if len(words) < 5 or words[1].lower() != "variable" or words[3] != "=":
        where = f"{path}:{line_of(text, start)}"
        raise RuleError(f"{where}: write `set variable name = value;  -- unit: meaning`")
    return words


def _plain(value: str) -> tuple[Any, str] | None:
    """Value and type of a plain literal; None of what DuckDB has to evaluate."""
    if _NUMBER.fullmatch(value):
        return Decimal(value), "DECIMAL"
    if _TEXT.fullmatch(value):
        return value[1:-1], "VARCHAR"
    return None


def _evaluated(
    path: Path,
    text: str,
    settings: list[Token],
    names: list[str],
    connection: duckdb.DuckDBPyConnection,
) -> list[tuple[Any, str]]:
    """Run the lines; read values and types back at once."""
    values = [f"getvariable({quoted(n)}), typeof(getvariable({quoted(n)}))" for n in names]
    lines = [*(statement for _, statement in settings), f"select {', '.join(values)}"]
    try:
        (row,) = connection.execute(";\n".join(lines)).fetchall()
    except duckdb.Error:
        _run_each(path, text, settings, connection)
        raise
    return list(zip(row[::2], row[1::2], strict=True))


def _run_each(
    path: Path, text: str, settings: list[Token], connection: duckdb.DuckDBPyConnection
) -> None:
    """Find the line that does not run."""
    for start, statement in settings:
        try:
            connection.execute(statement)
        except duckdb.Error as error:
            raise RuleError(located(path, line_of(text, start), error)) from error


def _kind(value: Any, type_name: str) -> Kind | None:
    """What an override of a parameter of this type must be."""
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, str):
        return "text"
    numbers = ("DECIMAL", "DOUBLE", "FLOAT", "TINYINT", "SMALLINT", "INTEGER", "BIGINT")
    return "number" if value is not None and type_name.partition("(")[0] in numbers else None


def _comment(text: str, end: int) -> tuple[str, str]:
    """Unit and meaning from the comment behind a statement, on the same line."""
    rest = text.encode()[end:].decode().partition("\n")[0].lstrip(" ;")
    if not rest.startswith("--"):
        return "", ""
    unit, colon, meaning = rest[2:].partition(": ")
    return (unit.strip(), meaning.strip()) if colon else ("", unit.strip())
