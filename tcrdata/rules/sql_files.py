"""Reads a file of SQL that decides: header, parameters, one select.

Such a file runs as it is in any DuckDB shell. Here DuckDB's own tokenizer finds the statements and
the places where a parameter is used, so that strings and comments can never be mistaken for either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import duckdb

from tcrdata.errors import RuleError
from tcrdata.rules.scopes import located, quoted

Kind = Literal["number", "text", "true or false"]
Token = tuple[int, str]  # byte offset, text


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


@dataclass(frozen=True)
class SqlFile:
    """A parsed file.

    Attributes:
        path: file.
        decides: first paragraph of the header.
        fields: `-- name: value` lines of the header.
        parameters: in the order of the file.
        select: the one select, without comments around it and without its semicolon.
        select_line: 1-based line at which it starts.
    """

    path: Path
    decides: str
    fields: dict[str, str]
    parameters: tuple[Parameter, ...]
    select: str
    select_line: int

    @property
    def name(self) -> str:
        """Name of the file without its ending."""
        return self.path.stem


def read_sql_file(
    path: Path,
    field_names: tuple[str, ...],
    connection: duckdb.DuckDBPyConnection,
    may_have: tuple[str, ...] = (),
) -> SqlFile:
    """Read and split a file; nothing is bound yet.

    Args:
        path: file.
        field_names: fields that the header must have.
        connection: runs the `set variable` lines.
        may_have: fields that it may have besides.

    Raises:
        RuleError: with file and line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RuleError(f"{path}: cannot be read ({error}); give a readable UTF-8 file") from error
    decides, fields = _header(text, (*field_names, *may_have))
    missing = [name for name in field_names if name not in fields]
    if missing or not decides:
        wanted = f"a line '-- {missing[0]}: ...'" if missing else "a sentence on what it decides"
        raise RuleError(f"{path}:1: the header comment lacks {wanted}")
    *settings, (select_at, select) = _statements(path, text)
    parameters = _parameters(path, text, settings, connection)
    for index, parameter in enumerate(parameters):
        if parameter.name in (earlier.name for earlier in parameters[:index]):
            raise RuleError(f"{path}:{parameter.line}: parameter {parameter.name} is set twice")
    return SqlFile(path, decides, fields, parameters, select, _line(text, select_at))


def uses(select: str) -> list[tuple[str, int]]:
    """Parameters that a select reads: name, and line within the select (0-based)."""
    return [(name, _line(select, start) - 1) for start, _, name in _places(select)]


def fill_in(select: str, literals: Mapping[str, str]) -> str:
    """Put literals in the place of `getvariable('name')`, by position."""
    data = select.encode()
    for start, end, name in reversed(_places(select)):
        data = data[:start] + f"({literals[name]})".encode() + data[end:]
    return data.decode()


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


def _header(text: str, field_names: tuple[str, ...]) -> tuple[str, dict[str, str]]:
    """First paragraph and fields of the comment lines at the top; indented lines go on."""
    paragraph: list[str] = []
    fields: dict[str, str] = {}
    current = None
    for line in text.splitlines():
        if not line.startswith("--"):
            break
        body = line[2:]
        name, colon, value = body.partition(":")
        if colon and name.strip() in field_names:
            current = name.strip()
            fields[current] = value.strip()
        elif current and body.startswith("  "):
            fields[current] += " " + body.strip()
        elif not fields and current is None and body.strip():
            paragraph.append(body.strip())
        else:
            current = ""
    return " ".join(paragraph), fields


def _tokens(sql: str) -> list[Token]:
    """Tokens without comments (which only some DuckDB versions report)."""
    data = sql.encode()
    starts = [start for start, _ in duckdb.tokenize(sql)]
    ends = [*starts[1:], len(data)][: len(starts)]
    tokens = [(a, data[a:b].decode()) for a, b in zip(starts, ends, strict=True)]
    return [(a, text) for a, text in tokens if not text.startswith(("--", "/*"))]


def _statements(path: Path, text: str) -> list[Token]:
    """Split at semicolons: `set` statements, then one select."""
    try:
        kinds = [statement.type for statement in duckdb.extract_statements(text)]
    except duckdb.Error as error:
        raise RuleError(located(path, 1, error)) from error
    spans: list[list[Token]] = [[]]
    for start, token in _tokens(text):
        if token.startswith(";"):
            spans.append([])
        else:
            spans[-1].append((start, token))
    pieces = [_span(text, span) for span in spans if span]
    if not pieces or len(pieces) != len(kinds):
        raise RuleError(f"{path}:1: holds no statement; it needs one select")
    for kind, (start, _) in zip(kinds[:-1], pieces[:-1], strict=True):
        if kind != duckdb.StatementType.SET:
            raise RuleError(
                f"{path}:{_line(text, start)}: only `set variable` lines may stand before "
                f"the one select, this is {kind.name}"
            )
    if kinds[-1] != duckdb.StatementType.SELECT:
        raise RuleError(
            f"{path}:{_line(text, pieces[-1][0])}: must end with one select, "
            f"this is {kinds[-1].name}; a rule or preset only reads"
        )
    return pieces


def _span(text: str, span: list[Token]) -> Token:
    """Text from the first token of a statement to the end of its last."""
    start, (last, token) = span[0][0], span[-1]
    return start, text.encode()[start : last + len(token.encode())].decode().strip()


def _parameters(
    path: Path, text: str, settings: list[Token], connection: duckdb.DuckDBPyConnection
) -> tuple[Parameter, ...]:
    """Run the `set variable` lines and read all values back, at once."""
    if not settings:
        return ()
    names = [_name_set(path, text, *setting) for setting in settings]
    values = [f"getvariable({quoted(n)}), typeof(getvariable({quoted(n)}))" for n in names]
    lines = [*(statement for _, statement in settings), f"select {', '.join(values)}"]
    try:
        (row,) = connection.execute(";\n".join(lines)).fetchall()
    except duckdb.Error:
        _run_each(path, text, settings, connection)
        raise
    found = []
    for (at, statement), name, value, type_name in zip(
        settings, names, row[::2], row[1::2], strict=True
    ):
        line, kind = _line(text, at), _kind(value, type_name)
        if kind is None:
            reason = f"{name} is {type_name}; a parameter is a number, text or boolean"
            raise RuleError(f"{path}:{line}: {reason}")
        unit, meaning = _comment(text, at + len(statement.encode()))
        found.append(Parameter(name, to_literal(value, kind), kind, unit, meaning, path, line))
    return tuple(found)


def _name_set(path: Path, text: str, start: int, statement: str) -> str:
    """Name of the variable that a line sets."""
    words = [token.strip() for _, token in _tokens(statement)]
    if len(words) < 5 or words[1].lower() != "variable" or words[3] != "=":
        where = f"{path}:{_line(text, start)}"
        raise RuleError(f"{where}: write `set variable name = value;  -- unit: meaning`")
    return words[2]


def _run_each(
    path: Path, text: str, settings: list[Token], connection: duckdb.DuckDBPyConnection
) -> None:
    """Find the line that does not run."""
    for start, statement in settings:
        try:
            connection.execute(statement)
        except duckdb.Error as error:
            raise RuleError(located(path, _line(text, start), error)) from error


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


@lru_cache(maxsize=256)
def _places(select: str) -> tuple[tuple[int, int, str], ...]:
    """Byte spans of `getvariable('name')` and the names; a text is filled in again and again."""
    tokens = _tokens(select)
    places = []
    for (start, word), opened, (_, text), (last, closed) in zip(
        tokens, tokens[1:], tokens[2:], tokens[3:], strict=False
    ):
        call = (word.strip().lower(), opened[1].strip(), closed.strip()[:1])
        if call == ("getvariable", "(", ")") and text.startswith("'"):
            places.append((start, last + 1, text.strip()[1:-1]))
    return tuple(places)


def _line(text: str, byte_offset: int) -> int:
    """1-based line of a byte offset."""
    return text.encode()[:byte_offset].count(b"\n") + 1
